//! Polynomials through values, or values and derivatives, at several times, with two derivatives: Newton's form.
//!
//! Equation: divided differences; a node that has a derivative counts twice (Burden and Faires, Numerical Analysis,
//! section 3.4). Nothing is allocated. Tests: polynomials of the degree are exact.

/// Most nodes, doubled ones counted twice: degree 27, the highest of SPICE kernels (types 9 and 13 of SPK).
pub(crate) const MOST_NODES: usize = 28;

/// A polynomial in `N` components.
pub(crate) struct Newton<const N: usize> {
    times: [f64; MOST_NODES],
    differences: [[f64; N]; MOST_NODES],
    count: usize,
}

impl<const N: usize> Newton<N> {
    /// Returns the polynomial through these values; times must differ. Of more than [`MOST_NODES`] the first are taken.
    pub(crate) fn through(nodes: impl Iterator<Item = (f64, [f64; N])>) -> Self {
        Self::of(nodes.map(|(t, value)| (t, value, [0.0; N])), false)
    }

    /// Returns the polynomial through these values with these derivatives.
    pub(crate) fn through_with_derivatives(nodes: impl Iterator<Item = (f64, [f64; N], [f64; N])>) -> Self {
        Self::of(nodes, true)
    }

    fn of(nodes: impl Iterator<Item = (f64, [f64; N], [f64; N])>, is_doubled: bool) -> Self {
        let (mut times, mut differences) = ([0.0; MOST_NODES], [[0.0; N]; MOST_NODES]);
        let mut slopes = [[0.0; N]; MOST_NODES];
        let mut count = 0;
        for (t, value, slope) in nodes {
            for _ in 0..1 + usize::from(is_doubled) {
                if count < MOST_NODES {
                    (times[count], differences[count], slopes[count]) = (t, value, slope);
                    count += 1;
                }
            }
        }
        for order in 1..count {
            for place in (order..count).rev() {
                let step = times[place] - times[place - order];
                // Only a doubled node has a step of zero, and only at first order.
                let is_same = order == 1 && is_doubled && place % 2 == 1;
                for n in 0..N {
                    let risen = differences[place][n] - differences[place - 1][n];
                    differences[place][n] = if is_same { slopes[place][n] } else { risen / step };
                }
            }
        }
        Self { times, differences, count }
    }

    /// Returns value, first and second derivative at `t`.
    pub(crate) fn at(&self, t: f64) -> [[f64; N]; 3] {
        let [mut value, mut first, mut second] = [[0.0; N]; 3];
        for place in (0..self.count).rev() {
            let off = t - self.times[place];
            for n in 0..N {
                second[n] = second[n] * off + 2.0 * first[n];
                first[n] = first[n] * off + value[n];
                value[n] = value[n] * off + self.differences[place][n];
            }
        }
        [value, first, second]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polynomial(degree: i32, t: f64) -> [f64; 3] {
        let n = f64::from(degree);
        [t.powi(degree) - t, n * t.powi(degree - 1) - 1.0, n * (n - 1.0) * t.powi(degree - 2)]
    }

    #[test]
    fn polynomials_of_the_degree_are_exact_and_higher_ones_are_not() {
        let off = |degree: i32, nodes: u32, has_slopes: bool| {
            let times = (0..nodes).map(|i| 0.3 * f64::from(i) - 0.4);
            let of = |t: f64| polynomial(degree, t);
            let newton = if has_slopes {
                Newton::through_with_derivatives(times.map(|t| (t, [of(t)[0]], [of(t)[1]])))
            } else {
                Newton::through(times.map(|t| (t, [of(t)[0]])))
            };
            (0..40).map(|i| 0.02 * f64::from(i) - 0.35).fold(0.0_f64, |worst, t| {
                let got = newton.at(t);
                let errors = got.iter().zip(of(t)).map(|([got], wanted)| (got - wanted).abs());
                errors.fold(worst, f64::max)
            })
        };
        for nodes in 2..=8 {
            let degree = i32::try_from(nodes).unwrap() - 1;
            assert!(off(degree.max(2) - i32::from(nodes == 2), nodes, false) < 1e-10, "{nodes} nodes");
            assert!(off(degree + 2, nodes, false) > 1e-9, "{nodes} nodes, control");
        }
        for nodes in 2..=4 {
            let degree = 2 * i32::try_from(nodes).unwrap() - 1;
            assert!(off(degree, nodes, true) < 1e-9, "{nodes} doubled nodes");
            assert!(off(degree + 1, nodes, true) > 1e-9, "{nodes} doubled nodes, control");
        }
    }
}
