//! Share of a map explained by other maps.

/// Relative remainder below which a column adds nothing new.
const LEAST: f64 = 1e-3;

/// Orthonormal columns.
#[derive(Default)]
pub struct Basis(Vec<Vec<f64>>);

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Basis {
    /// The part of a column orthogonal to `self`.
    pub fn rest(&self, mut column: Vec<f64>) -> Vec<f64> {
        // twice, because of rounding
        for _ in 0..2 {
            for known in &self.0 {
                let share = dot(known, &column);
                column.iter_mut().zip(known).for_each(|(v, k)| *v -= share * k);
            }
        }
        column
    }

    /// Adds the new part of a column; returns it normalised, if there is any.
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

/// Mean square of the part of a map that orthonormal columns explain.
pub fn explained(columns: &[Vec<f64>], map: &[f64]) -> f64 {
    columns.iter().map(|column| dot(column, map).powi(2)).sum::<f64>() / map.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For a map made of two columns, each explains half by its new part.
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
