//! Symmetric matrices of a few rows.

/// Rows of a square matrix.
pub type Matrix = Vec<Vec<f64>>;

/// Eigenvalues of a symmetric matrix, ascending, and its eigenvectors of length 1, in the same order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Eigen {
    /// The values.
    pub values: Vec<f64>,
    /// A vector for each.
    pub vectors: Matrix,
}

impl Eigen {
    /// By Jacobi's method (Golub and Van Loan 2013, section 8.5): rotations that make the largest elements beside the
    /// diagonal 0, row by row, until all are.
    pub fn of(matrix: &[Vec<f64>]) -> Self {
        let n = matrix.len();
        let mut a = matrix.to_vec();
        let mut v = identity(n);
        for _sweep in 0..64 {
            let beside: f64 =
                (0..n).flat_map(|p| (0..p).map(move |q| (p, q))).map(|(p, q)| a[p][q].abs()).sum();
            let along: f64 = (0..n).map(|p| a[p][p].abs()).sum();
            if beside <= 1e-17 * along || beside.is_nan() {
                break;
            }
            for p in 0..n {
                for q in p + 1..n {
                    rotate(&mut a, &mut v, p, q);
                }
            }
        }
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|i, j| a[*i][*i].total_cmp(&a[*j][*j]));
        Self {
            values: order.iter().map(|i| a[*i][*i]).collect(),
            vectors: order.iter().map(|i| (0..n).map(|k| v[k][*i]).collect()).collect(),
        }
    }

    /// The matrix with these vectors and a function of the values.
    pub fn map(&self, f: impl Fn(f64) -> f64) -> Matrix {
        let n = self.values.len();
        let mut sum = vec![vec![0.0; n]; n];
        for (value, vector) in self.values.iter().zip(&self.vectors) {
            let value = f(*value);
            for i in 0..n {
                for j in 0..n {
                    sum[i][j] += value * vector[i] * vector[j];
                }
            }
        }
        sum
    }
}

fn rotate(a: &mut Matrix, v: &mut Matrix, p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = if theta < 0.0 { -1.0 } else { 1.0 } / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for row in a.iter_mut().chain(v.iter_mut()) {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    for k in 0..a.len() {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
    }
}

/// The matrix that changes nothing.
pub fn identity(n: usize) -> Matrix {
    (0..n).map(|i| (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect()).collect()
}

/// A matrix times a vector.
pub fn times(matrix: &[Vec<f64>], vector: &[f64]) -> Vec<f64> {
    matrix.iter().map(|row| dot(row, vector)).collect()
}

/// Sum of products.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Mean and covariance of points with weights whose sum is 1.
pub fn mean_and_covariance(points: &[Vec<f64>], weights: &[f64]) -> (Vec<f64>, Matrix) {
    let n = points.first().map_or(0, Vec::len);
    let mut mean = vec![0.0; n];
    for (x, w) in points.iter().zip(weights) {
        for k in 0..n {
            mean[k] += w * x[k];
        }
    }
    let mut covariance = vec![vec![0.0; n]; n];
    for (x, w) in points.iter().zip(weights) {
        for i in 0..n {
            for j in 0..n {
                covariance[i][j] += w * (x[i] - mean[i]) * (x[j] - mean[j]);
            }
        }
    }
    (mean, covariance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_are_those_of_the_matrix() {
        // Values 1, 2 and 4 with the vectors (1, 1, 0)/√2, (0, 0, 1) and (1, -1, 0)/√2.
        let matrix = vec![vec![2.5, -1.5, 0.0], vec![-1.5, 2.5, 0.0], vec![0.0, 0.0, 2.0]];
        let eigen = Eigen::of(&matrix);
        for (found, expected) in eigen.values.iter().zip([1.0, 2.0, 4.0]) {
            assert!((found - expected).abs() < 1e-14, "{eigen:?}");
        }
        for (value, vector) in eigen.values.iter().zip(&eigen.vectors) {
            assert!((dot(vector, vector) - 1.0).abs() < 1e-14);
            for (left, right) in times(&matrix, vector).iter().zip(vector) {
                assert!((left - value * right).abs() < 1e-14, "{eigen:?}");
            }
        }
        let inverse = eigen.map(|x| 1.0 / x);
        for k in 0..3 {
            let column: Vec<f64> = inverse.iter().map(|row| row[k]).collect();
            for (found, expected) in times(&matrix, &column).iter().zip(&identity(3)[k]) {
                assert!((found - expected).abs() < 1e-14, "{inverse:?}");
            }
        }
    }

    #[test]
    fn mean_and_covariance_are_weighted() {
        let (mean, covariance) =
            mean_and_covariance(&[vec![0.0, 1.0], vec![2.0, 1.0], vec![4.0, 5.0]], &[0.25, 0.5, 0.25]);
        assert_eq!(mean, [2.0, 2.0]);
        assert_eq!(covariance, [[2.0, 2.0], [2.0, 3.0]]);
    }
}
