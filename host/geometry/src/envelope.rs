//! Symmetric positive definite systems within their envelope, by LLᵀ.
//!
//! In: the first column of each row, entries on and below the diagonal, a right-hand side. Out: the solution. The
//! envelope fills up and does not grow, so the order of the unknowns determines the cost. Source: Golub and Van Loan,
//! "Matrix Computations" (2013), 4.3. Not covered: pivoting: a pivot that rounding has reduced to 0 is replaced by
//! the least positive number.

/// Normal equations in their envelope: row i has the columns from `first[i]` to i.
#[derive(Clone, Debug)]
pub struct Envelope {
    first: Vec<usize>,
    rows: Vec<Vec<f64>>,
    right: Vec<f64>,
}

impl Envelope {
    /// A zero matrix; `first` has the first column of each row, not beyond its diagonal.
    pub fn new(first: Vec<usize>) -> Envelope {
        let rows = first.iter().enumerate();
        Envelope {
            rows: rows
                .map(|(row, first)| vec![0.0; row + 1 - first])
                .collect(),
            right: vec![0.0; first.len()],
            first,
        }
    }

    /// Adds to an entry; those above the diagonal are left to their mirror images.
    pub fn put(&mut self, row: usize, column: usize, value: f64) {
        if column <= row {
            self.rows[row][column - self.first[row]] += value;
        }
    }

    /// Holds an unknown at a value.
    pub fn hold(&mut self, held: usize, value: f64) {
        let first = self.first[held];
        for column in first..held {
            let weight = std::mem::take(&mut self.rows[held][column - first]);
            self.right[column] -= weight * value;
        }
        for row in held + 1..self.rows.len() {
            if self.first[row] <= held {
                let weight = std::mem::take(&mut self.rows[row][held - self.first[row]]);
                self.right[row] -= weight * value;
            }
        }
        self.rows[held][held - first] = 1.0;
        self.right[held] = value;
    }

    /// The unknowns: LLᵀ in place, forwards, backwards.
    pub fn solved(mut self) -> Vec<f64> {
        for row in 0..self.rows.len() {
            let first = self.first[row];
            let (above, own) = self.rows.split_at_mut(row);
            let own = &mut own[0];
            for column in first..row {
                let other = &above[column];
                let from = first.max(self.first[column]);
                let (mine, its) = (
                    &own[from - first..column - first],
                    &other[from - self.first[column]..column - self.first[column]],
                );
                let sum = dot(mine, its);
                let pivot = other[column - self.first[column]];
                own[column - first] = (own[column - first] - sum) / pivot;
            }
            let squares = dot(&own[..row - first], &own[..row - first]);
            // A pivot that rounding has brought to 0 belongs to a place that nothing holds.
            own[row - first] = (own[row - first] - squares).max(f64::MIN_POSITIVE).sqrt();
        }
        let mut solution = self.right;
        for row in 0..self.rows.len() {
            let first = self.first[row];
            let own = &self.rows[row];
            let known = solution[first..row].iter().zip(own);
            let sum: f64 = known.map(|(a, b)| a * b).sum();
            solution[row] = (solution[row] - sum) / own[row - first];
        }
        for row in (0..self.rows.len()).rev() {
            let first = self.first[row];
            let own = &self.rows[row];
            solution[row] /= own[row - first];
            let here = solution[row];
            for (value, weight) in solution[first..row].iter_mut().zip(own) {
                *value -= weight * here;
            }
        }
        solution
    }
}

/// Sum of products, in four sums side by side: one alone waits for each addition.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (fours, others) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest = fours.remainder().iter().zip(others.remainder());
    let rest: f64 = rest.map(|(a, b)| a * b).sum();
    let mut sums = [0.0; 4];
    for (a, b) in fours.zip(others) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: the system is solved. Method: a chain of springs between two held ends, whose answer is even steps.
    #[test]
    fn a_chain_of_springs_hangs_evenly() {
        let mut chain = Envelope::new((0..9usize).map(|row| row.saturating_sub(2)).collect());
        for row in 1..9 {
            chain.put(row, row, 2.0);
            chain.put(row, row - 1, -1.0);
        }
        chain.hold(0, 2.0);
        chain.hold(8, 10.0);
        for (k, place) in chain.solved().iter().enumerate() {
            assert!((place - 2.0 - k as f64).abs() < 1e-6, "{k} {place}");
        }
    }
}
