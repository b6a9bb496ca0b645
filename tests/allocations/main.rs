//! Tests that after its first frames the frame path allocates nothing: planning, CPU drawing, detector, and the whole
//! frame engine; nor do packets on real links, nor frames sent to several sinks. Imports hold no more memory than
//! allowed.
//!
//! One test, so that no other one allocates beside it. Left out: sinks that write files, the GPU driver, the link's
//! threads.
#![allow(
    unsafe_code,
    reason = "a global allocator is unsafe to implement; tests/allocations/counting.rs says why it holds"
)]
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod counting;
mod engine;
mod imports;
mod links;
mod scenes;
mod sinks;

use counting::{Counting, Found, allocations_in};
use std::collections::BTreeMap;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Returns the errors of a case: its own allocations, by place.
fn complaints(case: &str, found: &[Found]) -> Vec<String> {
    let mut by_place = BTreeMap::<String, (usize, usize)>::new();
    for found in found.iter().filter(|found| found.is_ours()) {
        let (times, bytes) = by_place.entry(found.place()).or_default();
        (*times, *bytes) = (*times + 1, *bytes + found.bytes);
    }
    let line = |(place, (times, bytes))| format!("{case}: {times} times, {bytes} bytes in all: {place}");
    by_place.into_iter().map(line).collect()
}

#[test]
fn frames_allocate_nothing_once_warm_and_imports_keep_their_bound() {
    // As in the program: jobs from a thread outside the pool would go through a queue that allocates.
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global().unwrap();
    let control = allocations_in(|| drop(std::hint::black_box(vec![1_u8; 100])));
    assert_eq!(complaints("control", &control).len(), 1, "one allocation is seen: {control:?}");
    let elsewhere =
        allocations_in(|| rayon::broadcast(|_| drop(std::hint::black_box(vec![1_u8; 100]))).into_iter().for_each(drop));
    assert!(elsewhere.len() >= rayon::current_num_threads(), "so are other threads': {elsewhere:?}");
    let mut wrong = Vec::new();
    for scene in scenes::all() {
        let mut drawn = scenes::Drawn::new(&scene);
        (0..scenes::WARM_UP).for_each(|number| drawn.frame(number));
        let found = allocations_in(|| (scenes::WARM_UP..scenes::FRAMES).for_each(|number| drawn.frame(number)));
        wrong.extend(complaints(scene.name, &found));
    }
    wrong.extend(engine::complaints_of_the_bench());
    wrong.extend(links::complaints_of_links());
    wrong.extend(sinks::complaints_of_sinks());
    wrong.extend(imports::complaints_of_imports());
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}
