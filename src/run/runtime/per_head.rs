//! A value for each head of a run.

/// A value for each head of a run; at least one.
#[derive(Debug, Clone)]
pub(super) struct PerHead<T> {
    first: T,
    others: Vec<T>,
}

impl<T> PerHead<T> {
    /// Returns the value of a run with one head.
    pub(super) fn new(first: T) -> Self {
        Self { first, others: Vec::new() }
    }

    /// Adds the value of the next head.
    pub(super) fn push(&mut self, next: T) {
        self.others.push(next);
    }

    /// Returns the value of a head; of the first one when the head does not exist.
    pub(super) fn of(&self, head: usize) -> &T {
        head.checked_sub(1).and_then(|place| self.others.get(place)).unwrap_or(&self.first)
    }

    /// Returns the value of a head for changes; of the first one when the head does not exist.
    pub(super) fn of_mut(&mut self, head: usize) -> &mut T {
        match head.checked_sub(1) {
            Some(place) if place < self.others.len() => &mut self.others[place],
            _ => &mut self.first,
        }
    }

    /// Does the same to the value of every head; returns the first one's result.
    pub(super) fn each<R>(&mut self, mut act: impl FnMut(&mut T) -> R) -> R {
        let result = act(&mut self.first);
        self.others.iter_mut().for_each(|other| drop(act(other)));
        result
    }
}
