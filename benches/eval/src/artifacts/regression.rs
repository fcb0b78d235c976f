//! How much of a map other maps explain.

/// What is left of a column, relative to itself, below which it is none of its own.
const LEAST: f64 = 1e-3;

/// Orthonormal columns.
#[derive(Default)]
pub struct Basis(Vec<Vec<f64>>);

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Basis {
    /// What `self` leaves of a column.
    pub fn rest(&self, mut column: Vec<f64>) -> Vec<f64> {
        // twice, as rounding leaves something the first time
        for _ in 0..2 {
            for known in &self.0 {
                let share = dot(known, &column);
                column.iter_mut().zip(known).for_each(|(v, k)| *v -= share * k);
            }
        }
        column
    }

    /// Adds what is new in a column; that, normalised, if there is anything.
    pub fn add(&mut self, column: Vec<f64>) -> Option<&[f64]> {
        let before = dot(&column, &column).sqrt();
        let rest = self.rest(column);
        let norm = dot(&rest, &rest).sqrt();
        if norm <= LEAST * before {
            return None;
        }
        self.0.push(rest.iter().map(|v| v / norm).collect());
        self.0.last().map(Vec::as_slice)
    }
}

/// Mean square of what orthonormal columns explain of a map.
pub fn explained(columns: &[Vec<f64>], map: &[f64]) -> f64 {
    columns.iter().map(|column| dot(column, map).powi(2)).sum::<f64>() / map.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map that is half one column and half another is explained half by what is new in the second.
    #[test]
    fn shares_are_those_of_the_columns() {
        let (a, b) = (vec![1.0, 1.0, 1.0, 1.0], vec![2.0, 0.0, 2.0, 0.0]);
        let mut basis = Basis::default();
        basis.add(a);
        let new = basis.add(b).unwrap().to_vec();
        assert_eq!(new, [0.5, -0.5, 0.5, -0.5]);
        // b minus its mean: ±1, mean square 1
        assert!((explained(&[new], &[2.0, 0.0, 2.0, 0.0]) - 1.0).abs() < 1e-12);
        assert!(basis.add(vec![3.0, 1.0, 3.0, 1.0]).is_none());
        assert!(basis.rest(vec![5.0, 1.0, 5.0, 1.0]).iter().all(|v| v.abs() < 1e-12));
    }
}
