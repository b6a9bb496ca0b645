//! Addresses: the camera's own, and those that frames go to.

use super::*;

#[test]
fn an_address_is_not_taken_and_that_of_another_is_none_of_its_business() {
    let mut bench = bench();
    let force = |mac: [u8; 6], address: [u8; 4]| {
        let (gap, mask) = ([0; 12], [255, 255, 255, 0]);
        [&[0, 0][..], &mac, &gap, &address, &gap, &mask, &gap, &[0; 4]].concat()
    };
    let (own_mac, own_address) = ([2, 0, 10, 0, 0, 1], [10, 0, 0, 1]);
    assert_eq!(bench.broadcast(A, 0x04, &force([2, 0, 10, 0, 0, 2], [10, 0, 0, 9])), None);
    assert_eq!(bench.ask(A, 0x04, &force([2, 0, 10, 0, 0, 2], [10, 0, 0, 9])), None);
    assert_eq!(bench.broadcast(A, 0x04, &force(own_mac, own_address)), Some((OK, vec![])));
    assert_eq!(bench.broadcast(A, 0x04, &force(own_mac, [10, 0, 0, 9])), Some((0x8001, vec![])));
    bench.control();
    assert_eq!(bench.broadcast(B, 0x04, &force(own_mac, [10, 0, 0, 9])), Some((0x8006, vec![])));
}

#[test]
fn frames_go_to_the_controller_and_to_one_other_only_when_the_bench_allows() {
    let to = |params: &Params, address: [u8; 4]| {
        let mut bench = Bench::new(params);
        bench.control();
        bench.write(A, at::STREAM_ADDRESS, u32::from_be_bytes(address))
    };
    let own = Params::default();
    let others = Params { allow_other_receivers: true, ..Params::default() };
    for (address, by_own, by_others) in [
        ([10, 0, 0, 7], OK, OK),
        ([0, 0, 0, 0], OK, OK),
        ([10, 0, 0, 8], 0x8002, OK),
        ([10, 0, 0, 255], 0x8002, 0x8002),
        ([255; 4], 0x8002, 0x8002),
        ([10, 0, 1, 8], 0x8002, 0x8002),
        ([239, 1, 1, 1], 0x8002, OK),
        ([224, 0, 0, 251], 0x8002, 0x8002),
    ] {
        assert_eq!((to(&own, address), to(&others, address)), (by_own, by_others), "{address:?}");
    }
}
