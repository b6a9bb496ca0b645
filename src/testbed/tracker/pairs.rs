//! Directions of pattern stars -> every pair within the field, found by its angle.
//!
//! The k-vector of Mortari & Neta, "k-vector range searching techniques", AAS 00-128 (2000): pairs are sorted by angle,
//! and a straight line from the least to the largest angle gives, for each of its steps, how many pairs lie below. A
//! range of angles is then read off without a search. Test: `pair_ranges_agree_with_brute_force`.

use glam::DVec3;

/// All pairs of a list of directions in a range of angles, sorted by angle.
#[derive(Debug, Clone)]
pub(super) struct PairIndex {
    angles_rad: Vec<f64>,
    stars: Vec<[u32; 2]>,
    below: Vec<u32>,
    first_rad: f64,
    step_rad: f64,
}

impl PairIndex {
    /// Indexes the pairs with angles from `shortest_rad` to `longest_rad`.
    pub(super) fn new(directions: &[DVec3], shortest_rad: f64, longest_rad: f64) -> Self {
        let mut pairs = collect(directions, shortest_rad, longest_rad);
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let angles_rad: Vec<f64> = pairs.iter().map(|pair| pair.0).collect();
        let stars = pairs.into_iter().map(|pair| pair.1).collect();
        let (first_rad, last_rad) = (shortest_rad, longest_rad);
        let steps = angles_rad.len().max(1);
        let step_rad = (last_rad - first_rad).max(f64::MIN_POSITIVE) / steps as f64;
        let mut below = Vec::with_capacity(steps + 1);
        let mut count = 0_usize;
        for step in 0..=steps {
            let line = first_rad + step as f64 * step_rad;
            while angles_rad.get(count).is_some_and(|angle| *angle < line) {
                count += 1;
            }
            below.push(u32::try_from(count).unwrap_or(u32::MAX));
        }
        Self { angles_rad, stars, below, first_rad, step_rad }
    }

    /// Returns the pairs whose angle is within `tolerance_rad` of `angle_rad`.
    pub(super) fn within(&self, angle_rad: f64, tolerance_rad: f64) -> &[[u32; 2]] {
        let (low, high) = (angle_rad - tolerance_rad, angle_rad + tolerance_rad);
        let mut start = self.line_below(low);
        while self.angles_rad.get(start).is_some_and(|angle| *angle < low) {
            start += 1;
        }
        let mut end = self.line_below(high).max(start);
        while self.angles_rad.get(end).is_some_and(|angle| *angle <= high) {
            end += 1;
        }
        &self.stars[start..end]
    }

    /// Returns how many pairs certainly lie below an angle.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the line's steps")]
    fn line_below(&self, angle_rad: f64) -> usize {
        let last = self.below.len() - 1;
        // One step down: rounding of the line must not skip a pair.
        let step = ((angle_rad - self.first_rad) / self.step_rad - 1.0).clamp(0.0, last as f64) as usize;
        self.below[step] as usize
    }
}

fn collect(directions: &[DVec3], shortest_rad: f64, longest_rad: f64) -> Vec<(f64, [u32; 2])> {
    let chord2 = |angle: f64| 4.0 * (angle / 2.0).sin().powi(2);
    let (shortest2, longest2) = (chord2(shortest_rad), chord2(longest_rad));
    let mut pairs = Vec::new();
    for (a, one) in (0_u32..).zip(directions) {
        for (b, other) in (a + 1..).zip(&directions[a as usize + 1..]) {
            let distance2 = one.distance_squared(*other);
            if (shortest2..=longest2).contains(&distance2) {
                pairs.push((angle_of_chord(distance2.sqrt()), [a, b]));
            }
        }
    }
    pairs
}

/// Returns the angle between unit vectors a chord apart, rad: exact for small angles, unlike the arc cosine.
pub(super) fn angle_of_chord(chord: f64) -> f64 {
    2.0 * (0.5 * chord).min(1.0).asin()
}
