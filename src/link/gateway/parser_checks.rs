//! Checks for the parsers of both gateways: streams cut anywhere, and random bytes.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Returns the contents of a stream after checking that they are the same however the stream is cut in two.
pub(super) fn read_in_pieces<P: Default, T: PartialEq + core::fmt::Debug>(
    stream: &[u8],
    parsed: impl Fn(&mut P, &[u8]) -> Vec<T>,
) -> Vec<T> {
    let whole = parsed(&mut P::default(), stream);
    for cut in 0..stream.len() {
        let mut parser = P::default();
        let mut pieces = parsed(&mut parser, &stream[..cut]);
        pieces.extend(parsed(&mut parser, &stream[cut..]));
        assert_eq!(pieces, whole, "cut at {cut}");
    }
    whole
}

/// Checks that a parser survives hundreds of thousands of random words: it refuses most of them, and accepts some by
/// chance.
pub(super) fn survives_random_words<P: Default, T, E>(
    words: &[&[u8]],
    count: u32,
    parsed: impl Fn(&mut P, &[u8]) -> Vec<Result<T, E>>,
) {
    let mut dice = StdRng::seed_from_u64(1);
    let mut parser = P::default();
    let (mut outcomes, mut accepted) = (0, 0);
    for _ in 0..count {
        let all = parsed(&mut parser, words[dice.random_range(0..words.len())]);
        outcomes += all.len();
        accepted += all.iter().filter(|outcome| outcome.is_ok()).count();
    }
    assert!(outcomes > 20_000 && accepted > 100 && accepted < outcomes, "{accepted} of {outcomes}");
}
