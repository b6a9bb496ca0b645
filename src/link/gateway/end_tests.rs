//! How gateways end: links of runs that are dead or alive, threads that are lost.

use super::tests::{CAN, bus, real_clock};
use super::*;
use std::io::{Read, Write};

#[test]
fn link_of_a_dead_run_is_replaced_and_that_of_a_live_run_is_not() {
    let clock = real_clock();
    let bus = bus(CAN, &clock);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("line");
    let params = GatewayParams { slcan_pty: Some(path.clone()), ..GatewayParams::default() };
    // A device that is gone, one that something else uses by now, and one whose number the next run may get again.
    let other = crate::serial::PseudoTerminal::open().unwrap();
    let again = crate::serial::PseudoTerminal::open().unwrap().path().to_path_buf();
    for stale in [Path::new("/dev/pts/999999"), other.path(), &again] {
        std::os::unix::fs::symlink(stale, &path).unwrap();
        drop(Gateways::start(&bus, &params, &clock).unwrap_or_else(|error| panic!("{}: {error}", stale.display())));
        assert!(std::fs::symlink_metadata(&path).is_err(), "replaced, and taken away at the end");
    }
    let live = Gateways::start(&bus, &params, &clock).unwrap();
    let device = std::fs::read_link(&path).unwrap();
    let refused = Gateways::start(&bus, &params, &clock).err().unwrap().to_string();
    assert!(refused.contains("a run that goes on"), "{refused}");
    assert_eq!(std::fs::read_link(&path).unwrap(), device, "left alone");
    drop(live);
    std::os::unix::fs::symlink("/dev/null", &path).unwrap();
    let refused = Gateways::start(&bus, &params, &clock).err().unwrap().to_string();
    assert!(refused.contains("nothing at it"), "control: a link to something else: {refused}");
}

/// A client's protocol that breaks down at once.
struct Broken;

impl Dialogue for Broken {
    fn read(&mut self, _: &[u8], _: &client::Client) {
        panic!("as the test wants it");
    }
}

#[test]
fn gateway_thread_that_panics_is_counted_and_takes_the_client_with_it() {
    let clock = real_clock();
    let bus = bus(CAN, &clock);
    let tally = Arc::new(Tally::default());
    let (near, mut far) = std::os::unix::net::UnixStream::pair().unwrap();
    near.set_nonblocking(true).unwrap();
    let parts = client::ClientParts {
        fd: near.into(),
        link: bus.attach(),
        clock: Arc::clone(&clock),
        tally: Arc::clone(&tally),
        on_stall: client::OnStall::HangUp,
        patience: Span::from_s(2.0),
        ended: Arc::default(),
        admission: None,
    };
    let thread = client::serve(parts, Box::new(Broken), pty::slcan_scribe()).unwrap().thread;
    let counts = || {
        let counters = tally.lock();
        (counters.lost_threads, counters.connected)
    };
    assert_eq!(counts(), (0, 1), "control: at work");
    far.write_all(b"x").unwrap();
    assert!(thread.join().is_err());
    far.read_to_end(&mut Vec::new()).unwrap(); // hung up on: the writer has ended too
    assert_eq!(counts(), (1, 0));
}
