//! Choice and order of the photographs to fit and to predict.

/// Orders of nine photographs, used in `docs/results.md` and in earlier measurements.
const NINE: [[usize; 9]; 4] = [
    [0, 1, 2, 3, 4, 5, 6, 7, 8],
    [0, 3, 8, 4, 7, 1, 2, 5, 6],
    [0, 7, 6, 5, 8, 2, 1, 3, 4],
    [5, 4, 3, 0, 6, 8, 7, 1, 2],
];

/// Photographs held out at the end of an order of four or more.
const HELD_OUT: usize = 2;

/// Sequence of photographs for a session.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Its row of the table.
    pub part: Part,
    /// Photographs to fit, in this order.
    pub fitted: Vec<usize>,
    /// Photographs to predict.
    pub held_out: Vec<usize>,
}

/// Plans with comparable errors: their held-out photographs do not depend on the number of fitted ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The first photograph alone predicts all others, for captures of two or three.
    FirstAlone,
    /// Every number of photographs predicts the same ones.
    Orders,
}

/// Plans for a capture of `count` photographs, at most `orders` orders.
///
/// With four or more, the last two of an order are held out; nine have published orders, other
/// numbers rotate. With three, the first predicts the other two, and every rotation holds one out.
/// With two, the first predicts the second. A single photograph leaves none to predict.
pub fn plans(count: usize, orders: usize) -> Vec<Plan> {
    let first = |held_out| Plan { part: Part::FirstAlone, fitted: vec![0], held_out };
    let split = |order: Vec<usize>, held_out: usize| {
        let (fitted, rest) = order.split_at(order.len() - held_out);
        Plan { part: Part::Orders, fitted: fitted.to_vec(), held_out: rest.to_vec() }
    };
    let rotated = |by: usize| (0..count).map(|i| (i + by) % count).collect::<Vec<_>>();
    match count {
        0 | 1 => Vec::new(),
        2 => vec![first(vec![1])],
        3 => {
            let rotations = (0..3.min(orders)).map(|by| split(rotated(by), 1));
            std::iter::once(first(vec![1, 2])).chain(rotations).collect()
        }
        9 => NINE.iter().take(orders).map(|order| split(order.to_vec(), HELD_OUT)).collect(),
        _ => {
            let orders = orders.min(count);
            (0..orders).map(|k| split(rotated(k * count / orders), HELD_OUT)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No photograph is both fitted and predicted, none is missing, and orders differ.
    #[test]
    fn orders_use_every_photograph_once() {
        for count in 3..20 {
            let plans = plans(count, 4);
            let orders: Vec<_> = plans.iter().filter(|p| p.part == Part::Orders).collect();
            assert_eq!(orders.len(), if count == 3 { 3 } else { 4 }, "{count}");
            for (i, plan) in orders.iter().enumerate() {
                let mut all = [plan.fitted.clone(), plan.held_out.clone()].concat();
                assert!(orders[..i].iter().all(|other| other.fitted != plan.fitted));
                all.sort_unstable();
                assert_eq!(all, (0..count).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn few_photographs_are_predicted_from_the_first() {
        assert_eq!(plans(1, 4), []);
        assert_eq!(plans(2, 4)[0].held_out, [1]);
        let three = plans(3, 4);
        assert_eq!((three.len(), &three[0].held_out[..]), (4, &[1, 2][..]));
        assert_eq!((&three[2].fitted[..], &three[2].held_out[..]), (&[1, 2][..], &[0][..]));
    }

    #[test]
    fn fewer_orders_are_the_first_of_more() {
        assert_eq!(plans(9, 2)[..], plans(9, 4)[..2]);
    }
}
