//! The last entries of an endless numbered sequence, in memory taken once.

/// A ring of the last entries, each known by its number from 0.
#[derive(Debug)]
pub(super) struct History<T> {
    entries: Vec<T>,
    capacity: usize,
    pushed: u64,
}

impl<T: Copy> History<T> {
    /// Keeps the last `capacity` entries; 1 at least.
    pub(super) fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { entries: Vec::with_capacity(capacity), capacity, pushed: 0 }
    }

    /// Adds entry number `self.next()`.
    pub(super) fn push(&mut self, entry: T) {
        if self.entries.len() < self.capacity {
            self.entries.push(entry);
        } else {
            let slot = self.slot(self.pushed);
            self.entries[slot] = entry;
        }
        self.pushed += 1;
    }

    /// Returns the number of the next entry.
    pub(super) fn next(&self) -> u64 {
        self.pushed
    }

    /// Returns the number of the oldest entry kept; `next` when there is none.
    pub(super) fn oldest(&self) -> u64 {
        self.pushed - self.entries.len() as u64
    }

    /// Returns the entry `number`, when it is kept.
    pub(super) fn get(&self, number: u64) -> Option<&T> {
        if number < self.oldest() || number >= self.pushed {
            return None;
        }
        self.entries.get(self.slot(number))
    }

    #[allow(clippy::cast_possible_truncation, reason = "a remainder of division by a usize fits")]
    fn slot(&self, number: u64) -> usize {
        (number % self.capacity as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_the_last_entries_by_number() {
        let mut history = History::new(3);
        assert_eq!((history.oldest(), history.next(), history.get(0)), (0, 0, None));
        for entry in 0..8u64 {
            history.push(entry * 10);
        }
        assert_eq!((history.oldest(), history.next()), (5, 8));
        assert_eq!([4, 5, 7, 8].map(|number| history.get(number).copied()), [None, Some(50), Some(70), None]);
    }
}
