//! The view as clients see it: raw requests over TCP, clients that misbehave, and frames that go on meanwhile.

use crate::live::view::tests::{head, params, params_of_three};
use crate::live::{CLIENTS_MAX, HeadParams, LiveSink, LiveView, Numbers, Params};
use base::clock::{Clock, Monotonic};
use base::image::DnImage;
use frames::sink::{SentFrame, Sink};
use frames::{report::RunNumbers, sink::sample::sample_frame};
use std::io::{ErrorKind, Read, Write};
use std::{net::TcpStream, sync::Arc, time::Duration};

/// Time without an answer after which a test treats the server as hung.
const HANGS: Duration = Duration::from_secs(30);

fn start() -> (LiveView, LiveSink, Numbers) {
    start_with(params())
}

fn start_with(params: Params) -> (LiveView, LiveSink, Numbers) {
    let (view, mut sinks, numbers) = start_all(params);
    (view, sinks.remove(0), numbers)
}

fn start_all(params: Params) -> (LiveView, Vec<LiveSink>, Numbers) {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    LiveView::start(params, clock).unwrap()
}

fn connect(view: &LiveView) -> TcpStream {
    let stream = TcpStream::connect(("127.0.0.1", view.address().port())).unwrap();
    stream.set_read_timeout(Some(HANGS)).unwrap();
    stream
}

/// Returns everything that comes back until the server hangs up.
fn all_of(mut stream: TcpStream) -> Vec<u8> {
    let mut answer = Vec::new();
    match stream.read_to_end(&mut answer) {
        Ok(_) => answer,
        // Unread bytes of a request make the system reset the connection.
        Err(error) if error.kind() == ErrorKind::ConnectionReset => answer,
        Err(error) => panic!("{error}"),
    }
}

/// Returns status, head and body of the answer to raw bytes.
fn ask(view: &LiveView, request: &[u8]) -> (u16, String, Vec<u8>) {
    let mut stream = connect(view);
    let _ = stream.write_all(request); // the server may refuse it half-way
    let answer = all_of(stream);
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").map_or(answer.len(), |at| at + 4);
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|word| word.parse().ok()).unwrap_or(0);
    (status, head, answer[end..].to_vec())
}

fn get(view: &LiveView, path: &str) -> (u16, String, Vec<u8>) {
    ask(view, format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes())
}

/// Returns a counter of the view's own.
fn counted(view: &LiveView, name: &str) -> u64 {
    let text = String::from_utf8(get(view, "/metrics").2).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name} in\n{text}")).parse().unwrap()
}

/// Asks until the answer is as wanted.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let begun = Monotonic::start();
    let from = begun.now();
    while !is_so() {
        assert!((begun.now() - from).s() < HANGS.as_secs_f64(), "{what}: not so for {HANGS:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn every_address_answers_and_what_it_promises_is_in_it() {
    let (view, mut sink, numbers) = start();
    assert_eq!(get(&view, "/frame.png").0, 404, "before the first frame");
    sink.send(&sample_frame(7)).unwrap();
    numbers.announce(&RunNumbers::NONE);
    let (status, head, body) = get(&view, "/");
    assert_eq!(status, 200);
    assert!(head.contains("content-security-policy: default-src 'none'"), "{head}");
    let page = String::from_utf8(body).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</script>\n"));
    let loads = page.replace("href=\"data:,\"", "").replace("href=\"#main\"", "");
    assert!(!loads.contains("src=") && !loads.contains("href=") && !loads.contains("@import"), "loads nothing");
    let (status, head, png) = get(&view, "/frame.png?stretch=linear");
    assert_eq!((status, &png[1..4]), (200, &b"PNG"[..]));
    assert!(head.contains("starloop-frame: 7\r\n") && head.contains("cache-control: no-store"), "{head}");
    let (_, head, truth) = get(&view, "/truth.json?frame=7");
    assert!(head.contains("application/json"), "{head}");
    let truth: serde_json::Value = serde_json::from_slice(&truth).unwrap();
    assert_eq!((&truth["frame"], &truth["stars_in_frame"]), (&7.into(), &2.into()));
    assert_eq!(get(&view, "/truth.json?frame=6").0, 404, "never shown");
    let state: serde_json::Value = serde_json::from_slice(&get(&view, "/state.json").2).unwrap();
    assert_eq!(state["frame"]["number"], 7);
    assert!(get(&view, "/metrics").1.contains("text/plain; version=0.0.4"));
    drop(sink);
    numbers.send_last(&RunNumbers::NONE);
    let state: serde_json::Value = serde_json::from_slice(&get(&view, "/state.json").2).unwrap();
    assert_eq!((&state["is_over"], &state["frame"]["number"]), (&true.into(), &7.into()), "the last one stays");
}

#[test]
fn frames_that_were_asked_for_are_kept_with_their_pixels() {
    let (view, mut sink, _numbers) = start();
    for number in 1..=3 {
        let mut frame = sample_frame(number);
        frame.image.pixels_mut()[31 * 4 + 5] = 7_000 + number as u16;
        sink.send(&frame).unwrap();
        assert_eq!(get(&view, "/frame.png?stretch=linear").0, 200);
    }
    let state: serde_json::Value = serde_json::from_slice(&get(&view, "/state.json").2).unwrap();
    assert_eq!(state["kept_frames"], serde_json::json!([1, 2, 3]));
    for number in 1..=3 {
        let pixel = get(&view, &format!("/pixel.json?frame={number}&x=5&y=4")).2;
        let pixel: serde_json::Value = serde_json::from_slice(&pixel).unwrap();
        assert_eq!((&pixel["dn"], &pixel["frame"]), (&(7_000 + number).into(), &number.into()));
        assert!(pixel["ra_deg"].is_f64() && pixel["dec_deg"].is_f64(), "the sample has a map of the sky: {pixel}");
        let (status, head, _) = get(&view, &format!("/frame.png?frame={number}&stretch=log"));
        assert!(status == 200 && head.contains(&format!("starloop-frame: {number}\r\n")), "{head}");
    }
    for (path, wanted) in [
        ("/pixel.json?frame=9&x=5&y=4", "wanted one of kept_frames"),
        ("/frame.png?frame=9", "wanted one of kept_frames"),
        ("/pixel.json?frame=1&x=31&y=4", "wanted x below 31 and y below 17"),
    ] {
        let (status, _, said) = get(&view, path);
        assert!(status == 404 && String::from_utf8_lossy(&said).contains(wanted), "{path}: {status}");
    }
}

#[test]
fn every_head_has_a_picture_and_stars_of_its_own() {
    let (view, mut sinks, _numbers) = start_all(params_of_three());
    for (head, sink) in (0_u8..).zip(&mut sinks) {
        let mut frame = sample_frame(10 + u32::from(head));
        frame.image.pixels_mut().fill(1_000 * u16::from(head));
        frame.truth.truncate(usize::from(head));
        sink.send(&frame).unwrap();
    }
    let darkest_to_brightest = "stretch=dn&black=0&white=2000";
    let mut pictures = Vec::new();
    for head in 0..3_u32 {
        let (status, said, png) = get(&view, &format!("/frame.png?head={head}&{darkest_to_brightest}"));
        assert_eq!(status, 200);
        for line in [format!("starloop-head: {head}\r\n"), format!("starloop-frame: {}\r\n", 10 + head)] {
            assert!(said.contains(&line), "{line} is not in {said}");
        }
        let truth = get(&view, &format!("/truth.json?head={head}&frame={}", 10 + head)).2;
        let truth: serde_json::Value = serde_json::from_slice(&truth).unwrap();
        assert_eq!(truth["stars_in_frame"], head);
        assert_eq!(get(&view, &format!("/truth.json?head={head}&frame={}", 10 + (head + 1) % 3)).0, 404, "another's");
        pictures.push(png);
    }
    let greys: Vec<u8> = pictures.iter().map(|png| first_grey(png)).collect();
    assert_eq!(greys, [0, 128, 255], "each its own");
    assert_eq!(get(&view, &format!("/frame.png?{darkest_to_brightest}")).2, pictures[0], "head 0 where none is named");
    let state: serde_json::Value = serde_json::from_slice(&get(&view, "/state.json?head=2").2).unwrap();
    assert_eq!((&state["head"], &state["frame"]["number"]), (&2.into(), &12.into()));
}

#[test]
fn head_beyond_the_last_is_refused_with_a_sentence() {
    let (view, mut sinks, _numbers) = start_all(params_of_three());
    sinks.iter_mut().for_each(|sink| sink.send(&sample_frame(1)).unwrap());
    for path in ["/frame.png?head=3", "/truth.json?head=3&frame=1", "/state.json?head=3"] {
        let (status, _, body) = get(&view, path);
        let said = String::from_utf8(body).unwrap();
        assert_eq!(status, 404, "{path}");
        assert_eq!(said, "head: got 3, wanted 0 to 2; /state.json lists the heads\n", "{path}");
    }
    for path in ["/frame.png?head=two", "/truth.json?head=-1&frame=1", "/state.json?haed=1"] {
        assert_eq!(get(&view, path).0, 400, "{path}");
    }
    for path in ["/frame.png?head=2", "/truth.json?head=2&frame=1", "/state.json?head=2"] {
        assert_eq!(get(&view, path).0, 200, "control: {path}");
    }
    let (only, _sink, _numbers) = start();
    let said = get(&only, "/frame.png?head=1").2;
    assert!(String::from_utf8_lossy(&said).contains("wanted 0, the only head of this run"));
}

/// Returns the first pixel of a PNG.
fn first_grey(png: &[u8]) -> u8 {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    pixels[0]
}

#[test]
fn only_questions_that_read_are_answered() {
    let (view, mut sink, _numbers) = start();
    sink.send(&sample_frame(1)).unwrap();
    for method in ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "BREW"] {
        let (status, head, _) = ask(&view, format!("{method} / HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes());
        assert_eq!(status, 405, "{method}");
        assert!(head.contains("allow: GET, HEAD"), "{head}");
    }
    let (status, head, body) = ask(&view, b"HEAD /frame.png HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert_eq!((status, body.len()), (200, 0));
    assert!(head.contains("content-length: "), "{head}");
    for (path, wanted, part) in [
        ("/nowhere", 404, "wanted /, /frame.png"),
        ("/../etc/passwd", 404, "wanted"),
        ("/frame.png?stretch=nice", 400, "wanted stars, faint"),
        ("/truth.json", 400, "a frame's number"),
    ] {
        let (status, _, body) = get(&view, path);
        assert_eq!(status, wanted, "{path}");
        assert!(String::from_utf8_lossy(&body).contains(part), "{path}: {}", String::from_utf8_lossy(&body));
    }
}

#[test]
fn other_names_are_not_answered() {
    let on_loopback = [
        ("localhost:8080", 200),
        ("LOCALHOST", 200),
        ("127.0.0.1:1", 200),
        ("[::1]:9090", 200),
        ("127.9.9.9", 200),
        ("example.org", 421),
        ("localhost.example.org", 421),
        ("192.0.2.1:80", 421),
        ("", 421),
        ("localhost:80@example.org", 421),
        ("[::1]example.org", 421),
        ("[::1", 421),
        ("localhost\r\nHost: example.org", 421),
    ];
    // Reached from elsewhere, an address cannot be a name that another site gave us.
    let on_a_network = [
        ("localhost:8080", 200),
        ("192.0.2.1:80", 200),
        ("[2001:db8::1]", 200),
        ("LAB-PC:9090", 200),
        ("example.org", 421),
        ("lab-pc.example.org", 421),
        ("192.0.2.1.example.org", 421),
        ("", 421),
    ];
    let exposed = Params { address: ([0, 0, 0, 0], 0).into(), names: vec!["lab-pc".into()], ..params() };
    for (params, hosts) in [(params(), &on_loopback[..]), (exposed, &on_a_network[..])] {
        let (view, _sink, _numbers) = start_with(params);
        for (host, wanted) in hosts {
            let (status, _, said) = ask(&view, format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes());
            assert_eq!(status, *wanted, "{host} of {}", view.address());
            assert_eq!(status == 421, String::from_utf8_lossy(&said).contains("--monitor-name"), "{host}");
        }
        assert_eq!(ask(&view, b"GET / HTTP/1.1\r\n\r\n").0, 421, "no host");
    }
}

#[test]
fn no_answer_may_be_shown_by_other_pages() {
    let (view, mut sink, _numbers) = start();
    sink.send(&sample_frame(1)).unwrap();
    for path in ["/", "/frame.png", "/state.json", "/metrics", "/nowhere"] {
        let head = get(&view, path).1;
        assert!(head.contains("cross-origin-resource-policy: same-origin\r\n"), "{path}: {head}");
    }
}

#[test]
fn bytes_other_than_requests_end_the_connection() {
    let (view, _sink, _numbers) = start();
    let long_header = format!("GET / HTTP/1.1\r\nHost: localhost\r\nX: {}\r\n\r\n", "x".repeat(64 * 1024));
    let many_headers = format!("GET / HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "A: b\r\n".repeat(200));
    let long_path = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "x".repeat(64 * 1024));
    let requests: [(&[u8], &[u16]); 6] = [
        (long_header.as_bytes(), &[431, 0]),
        (many_headers.as_bytes(), &[431]),
        (long_path.as_bytes(), &[414, 431, 0]),
        (b"\x00\xff\xfe garbage\r\n\r\n", &[400, 0]),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03 TLS, perhaps\r\n\r\n", &[400, 0]),
        (b"GET / HTTP/9.9\r\n\r\n", &[400, 505, 0]),
    ];
    for (request, wanted) in requests {
        let (status, ..) = ask(&view, request);
        assert!(wanted.contains(&status), "{status} to {}", String::from_utf8_lossy(&request[..20.min(request.len())]));
    }
    assert_eq!(get(&view, "/state.json").0, 200, "and others are served");
}

#[test]
fn half_a_request_is_given_up() {
    let (view, _sink, _numbers) = start();
    let mut silent = connect(&view);
    silent.write_all(b"GET / HT").unwrap();
    let said = all_of(silent);
    assert!(said.is_empty() || said.starts_with(b"HTTP/1.1 408"), "{}", String::from_utf8_lossy(&said));
    until("the client is counted", || counted(&view, "starloop_live_clients_failed_total") == 1);
}

/// Returns a frame of noise, which no PNG makes small: more than the system takes for a client that does not read.
fn large_frame(side_px: usize) -> SentFrame {
    let mut frame = sample_frame(0);
    frame.image = DnImage::new(side_px, side_px);
    let mut state = 1_u32;
    for dn in frame.image.pixels_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *dn = (state >> 16) as u16;
    }
    frame
}

#[test]
fn a_client_that_never_reads_is_hung_up_on() {
    let (view, mut sink, _numbers) = start();
    sink.send(&large_frame(2048)).unwrap();
    let mut client = connect(&view);
    client.write_all(b"GET /frame.png?stretch=linear HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    until("the client is counted", || counted(&view, "starloop_live_clients_failed_total") == 1);
    let got = all_of(client).len();
    assert!(got < 3_500_000, "{got} bytes of 4 MB and more");
    assert!(get(&view, "/frame.png?stretch=linear").2.len() > 4_000_000, "another one gets all of it");
}

#[test]
fn frames_go_on_whatever_clients_do() {
    let (view, mut sink, numbers) =
        start_with(Params { heads: vec![HeadParams { size_px: [1024; 2], ..head(0) }], ..params() });
    let mut frame = large_frame(1024);
    sink.send(&frame).unwrap();
    let mut bad_clients: Vec<TcpStream> = Vec::new();
    for number in 0..100 {
        let mut client = connect(&view);
        let said: &[u8] = match number % 4 {
            0 => b"GET /frame.png HTTP/1.1\r\nHost: localhost\r\n\r\n", // and never reads
            1 => b"\xff\x00\x01\x02 not HTTP",
            2 => b"GET / HTTP/1.1\r\nHost: loc",
            _ => b"",
        };
        let _ = client.write_all(said); // the server may hang up
        bad_clients.push(client);
        frame.meta.number = number;
        sink.send(&frame).unwrap();
        numbers.announce(&RunNumbers::NONE);
    }
    assert_eq!(sink.finish().unwrap().frames, 101, "every send came back");
    // With its seats taken the view hangs up; when their time is over it serves again, and has counted all of them.
    until("the view serves again", || {
        let mut stream = connect(&view);
        let _ = stream.write_all(b"GET /state.json HTTP/1.1\r\nHost: localhost\r\n\r\n"); // the server may hang up
        all_of(stream).starts_with(b"HTTP/1.1 200")
    });
    until("all hundred found no seat or lost it", || {
        let lost = ["starloop_live_clients_refused_total", "starloop_live_clients_failed_total"];
        lost.map(|name| counted(&view, name)).iter().sum::<u64>() >= 100
    });
    drop(bad_clients);
}

#[test]
fn half_requests_do_not_keep_others_out() {
    let (view, _sink, _numbers) = start();
    let half = |_| {
        let mut stream = connect(&view);
        stream.write_all(b"GET / HTTP/1.1\r\nHost: local").unwrap();
        stream
    };
    for _ in 0..5 {
        let halves: Vec<TcpStream> = (0..CLIENTS_MAX).map(half).collect();
        assert_eq!(get(&view, "/metrics").0, 200);
        drop(halves);
    }
    assert!(counted(&view, "starloop_live_clients_failed_total") >= 5, "those that made way are counted");
    assert_eq!(counted(&view, "starloop_live_clients_refused_total"), 0);
}

#[test]
fn answers_without_a_reader_do_not_keep_others_out() {
    let (view, mut sink, _numbers) =
        start_with(Params { heads: vec![HeadParams { size_px: [1024; 2], ..head(0) }], ..params() });
    sink.send(&large_frame(1024)).unwrap();
    let unread = |_| {
        let mut stream = connect(&view);
        stream.write_all(b"GET /frame.png HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        stream
    };
    let readers: Vec<TcpStream> = (0..CLIENTS_MAX).map(unread).collect();
    // Longer than an answer may take while another client waits, shorter than the time of a connection.
    std::thread::sleep(Duration::from_millis(1_300));
    assert_eq!(get(&view, "/state.json").0, 200);
    drop(readers);
    assert!(counted(&view, "starloop_live_clients_failed_total") >= 1, "the one that made way is counted");
    assert_eq!(counted(&view, "starloop_live_clients_refused_total"), 0);
}

#[test]
fn the_totals_of_a_run_are_served_before_the_view_ends() {
    let (view, mut sink, numbers) = start();
    sink.send(&sample_frame(7)).unwrap();
    let mut run = RunNumbers::NONE;
    (run.frames.rendered, run.frames.delivered) = (9, 5);
    numbers.announce(&run);
    let state = |view: &LiveView| -> serde_json::Value { serde_json::from_slice(&get(view, "/state.json").2).unwrap() };
    until("numbers", || state(&view)["run"]["frames"]["rendered"] == 9);
    drop(sink);
    assert_eq!(state(&view)["is_over"], false, "frames that are still counted come first");
    run.frames.delivered = 9;
    numbers.send_last(&run);
    let address = view.address();
    let ending = std::thread::Builder::new().name("end".into()).spawn(move || view.finish()).unwrap();
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let text = String::from_utf8(all_of(stream)).unwrap();
    for line in ["starloop_run_over 1\n", "starloop_frames_delivered_total 9\n", "starloop_frames_rendered_total 9\n"] {
        assert!(text.contains(line), "no {line} in\n{text}");
    }
    ending.join().unwrap();
}

#[test]
fn it_ends_at_once_with_clients_connected() {
    let (view, _sink, _numbers) = start();
    let client = connect(&view);
    drop(view);
    assert!(all_of(client).is_empty());
}
