//! Turns as plain matrices, for oracles that share nothing with the product.

pub type Vector = [f64; 3];
pub type Matrix = [[f64; 3]; 3];

pub fn x() -> Vector {
    [1.0, 0.0, 0.0]
}

pub fn y() -> Vector {
    [0.0, 1.0, 0.0]
}

pub fn z() -> Vector {
    [0.0, 0.0, 1.0]
}

/// A turn about a unit axis by the right hand: 1 c + [axis]x s + axis axisᵀ (1 - c).
pub fn about(axis: Vector, degrees: f64) -> Matrix {
    let (s, c) = degrees.to_radians().sin_cos();
    let [x, y, z] = axis;
    let cross = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let one = if i == j { c } else { 0.0 };
            one + s * cross[i][j] + (1.0 - c) * axis[i] * axis[j]
        })
    })
}

pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

pub fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

pub fn applied(a: &Matrix, v: Vector) -> Vector {
    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

pub fn plus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

pub fn scaled(a: Vector, by: f64) -> Vector {
    a.map(|share| by * share)
}
