//! The senses in which protocols have their quaternions, and the sign that keeps a series without jumps.

/// Which rotation a quaternion is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sense {
    /// As in starloop: `v_sensor = q v_icrf q*`.
    #[default]
    Starloop,
    /// Its conjugate.
    Conjugate,
}

impl Sense {
    /// Returns a quaternion of starloop in this sense, and the other way round.
    pub fn of(self, [w, x, y, z]: [f64; 4]) -> [f64; 4] {
        match self {
            Self::Starloop => [w, x, y, z],
            Self::Conjugate => [w, -x, -y, -z],
        }
    }
}

/// Chooses between `q` and `-q`, which are the same attitude: the one nearer to the last, at first the one with `w >=
/// 0`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Continuity {
    last: Option<[f64; 4]>,
}

impl Continuity {
    pub(crate) fn next(&mut self, q: [f64; 4]) -> [f64; 4] {
        let dot: f64 = match self.last {
            Some(last) => last.iter().zip(q).map(|(a, b)| a * b).sum(),
            None => q[0],
        };
        let same = if dot < 0.0 { q.map(|part| -part) } else { q };
        self.last = Some(same);
        same
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sign_follows_the_last_and_the_conjugate_turns_back() {
        let mut series = Continuity::default();
        assert_eq!(series.next([-0.6, 0.0, 0.8, 0.0]), [0.6, 0.0, -0.8, 0.0], "scalar not negative at first");
        assert_eq!(series.next([-0.1, 0.0, -0.99, 0.0]), [-0.1, 0.0, -0.99, 0.0], "nearer to the last as it is");
        assert_eq!(series.next([0.2, 0.0, 0.98, 0.0]), [-0.2, 0.0, -0.98, 0.0]);
        let q = [0.5, 0.1, -0.2, 0.3];
        assert_eq!(Sense::Conjugate.of(Sense::Conjugate.of(q)), q);
        assert_ne!(Sense::Conjugate.of(q), Sense::Starloop.of(q));
    }
}
