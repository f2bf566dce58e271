//! Symmetric matrices: of a few rows by their eigenvectors, of some hundred by their triangular root.

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

/// The lower triangle L with L Lᵀ = A of a symmetric matrix A that is positive definite.
#[derive(Clone, Debug, PartialEq)]
pub struct Cholesky {
    /// Row i has i + 1 elements.
    rows: Matrix,
}

impl Cholesky {
    /// Row by row (Golub and Van Loan 2013, section 4.2); none if the matrix is not positive definite. Of the matrix its lower
    /// triangle is read.
    pub fn of(matrix: &[Vec<f64>]) -> Option<Self> {
        let mut rows: Matrix = Vec::with_capacity(matrix.len());
        for (i, from) in matrix.iter().enumerate() {
            let mut row: Vec<f64> = Vec::with_capacity(i + 1);
            for j in 0..i {
                let above = &rows[j];
                row.push((from[j] - lanes(&row, &above[..j])) / above[j]);
            }
            let square = from[i] - lanes(&row, &row);
            if square.is_nan() || square <= 0.0 {
                return None;
            }
            row.push(square.sqrt());
            rows.push(row);
        }
        Some(Self { rows })
    }

    /// L⁻¹ b.
    pub fn forward(&self, b: &[f64]) -> Vec<f64> {
        let mut y: Vec<f64> = Vec::with_capacity(b.len());
        for (i, (row, b)) in self.rows.iter().zip(b).enumerate() {
            y.push((b - lanes(&row[..i], &y)) / row[i]);
        }
        y
    }

    /// A⁻¹ b.
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = self.forward(b);
        for (i, row) in self.rows.iter().enumerate().rev() {
            x[i] /= row[i];
            let (before, at) = x.split_at_mut(i);
            for (x, l) in before.iter_mut().zip(row) {
                *x -= l * at[0];
            }
        }
        x
    }

    /// The diagonal of A⁻¹.
    pub fn inverse_diagonal(&self) -> Vec<f64> {
        let n = self.rows.len();
        // A⁻¹ = L⁻ᵀ L⁻¹: squares of the columns of L⁻¹, each of which begins with its own unit.
        let column = |k: usize| {
            let mut y: Vec<f64> = Vec::with_capacity(n - k);
            for (i, row) in self.rows.iter().enumerate().skip(k) {
                let unit = if i == k { 1.0 } else { 0.0 };
                y.push((unit - lanes(&row[k..i], &y)) / row[i]);
            }
            lanes(&y, &y)
        };
        (0..n).map(column).collect()
    }

    /// The logarithm of the determinant of A.
    pub fn log_determinant(&self) -> f64 {
        2.0 * self.rows.iter().enumerate().map(|(i, row)| libm::log(row[i])).sum::<f64>()
    }
}

/// Sum of products in four sums side by side.
fn lanes(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest = dot(a4.remainder(), b4.remainder());
    for (a, b) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest
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
    fn triangular_roots_solve() {
        // Hilbert's matrix of 6 rows with 1 more on its diagonal.
        let n = 6;
        let matrix: Matrix = (0..n)
            .map(|i| (0..n).map(|j| 1.0 / (i + j + 1) as f64 + if i == j { 1.0 } else { 0.0 }).collect())
            .collect();
        let root = Cholesky::of(&matrix).unwrap();
        let x: Vec<f64> = (0..n).map(|k| k as f64 - 2.5).collect();
        for (found, expected) in root.solve(&times(&matrix, &x)).iter().zip(&x) {
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        }
        let eigen = Eigen::of(&matrix);
        let logs: f64 = eigen.values.iter().map(|v| v.ln()).sum();
        assert!((root.log_determinant() - logs).abs() < 1e-13, "{logs}");
        let inverse = eigen.map(|v| 1.0 / v);
        for (k, found) in root.inverse_diagonal().iter().enumerate() {
            assert!((found - inverse[k][k]).abs() < 1e-13, "{found}");
        }
        assert_eq!(Cholesky::of(&[vec![1.0, 2.0], vec![2.0, 1.0]]), None);
    }

    #[test]
    fn mean_and_covariance_are_weighted() {
        let (mean, covariance) =
            mean_and_covariance(&[vec![0.0, 1.0], vec![2.0, 1.0], vec![4.0, 5.0]], &[0.25, 0.5, 0.25]);
        assert_eq!(mean, [2.0, 2.0]);
        assert_eq!(covariance, [[2.0, 2.0], [2.0, 3.0]]);
    }
}
