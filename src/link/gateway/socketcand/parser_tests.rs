//! Every command, both sides of every length, and elements that come in pieces.

use super::*;
use crate::gateway::parser_checks::{read_in_pieces, survives_random_words};
use firmware_protocol::can::ToCanId;

type Outcome = Result<Command, SocketcandReject>;

fn parsed(parser: &mut Parser, bytes: &[u8]) -> Vec<Outcome> {
    let mut all = Vec::new();
    parser.push(bytes, &mut |outcome| all.push(outcome));
    all
}

fn one(element: &str) -> Outcome {
    let all = parsed(&mut Parser::default(), element.as_bytes());
    assert_eq!(all.len(), 1, "{element}: {all:?}");
    all[0]
}

fn classic(id: impl ToCanId, data: &[u8]) -> Outcome {
    Ok(Command::Send(CanFrame::classic(id, data).unwrap()))
}

#[test]
fn every_command_is_understood() {
    assert_eq!(one("< open can0 >"), Ok(Command::Open(BusName::new(b"can0").unwrap())));
    assert_eq!(BusName::new(b"can0").unwrap().as_bytes(), b"can0");
    let longest = BusName::new(b"abcdefghijklmno").unwrap();
    assert_eq!(one("< open abcdefghijklmno >"), Ok(Command::Open(longest)), "15 bytes");
    assert_eq!(one("< rawmode >"), Ok(Command::RawMode));
    assert_eq!(one("<rawmode>"), Ok(Command::RawMode), "without spaces");
    assert_eq!(one("<  echo\t>"), Ok(Command::Echo));
    assert_eq!(one("< send 123 0 >"), classic(0x123, &[]));
    assert_eq!(one("< send 7ff 3 0 a FF >"), classic(0x7FF, &[0, 10, 255]));
    assert_eq!(one("< send 001 0  >"), classic(1, &[]), "as python-can sends it");
    assert_eq!(one("< send 1 8 1 2 3 4 5 6 7 8 >"), classic(1, &[1, 2, 3, 4, 5, 6, 7, 8]));
}

#[test]
fn eight_digits_are_an_identifier_of_29_bits() {
    let id = |number| CanId::extended(number).unwrap();
    assert_eq!(one("< send 00000123 1 AB >"), classic(id(0x123), &[0xAB]));
    assert_ne!(one("< send 00000123 1 AB >"), one("< send 123 1 AB >"), "another identifier");
    assert_eq!(one("< send 1fffffff 0 >"), classic(id(0x1FFF_FFFF), &[]));
    assert_eq!(one("< send 0000123 0 >"), classic(0x123, &[]), "seven digits");
}

#[test]
fn malformed_commands_are_refused_by_reason() {
    use SocketcandReject::*;
    for (element, reason) in [
        ("< >", UnknownCommand),
        ("< dance >", UnknownCommand),
        ("< bcmmode >", OtherMode),
        ("< add 1 0 123 0 >", OtherMode),
        ("< open >", BadLength),
        ("< open can0 can1 >", BadLength),
        ("< open abcdefghijklmnop >", BadValue),
        ("< rawmode now >", BadLength),
        ("< send >", BadLength),
        ("< send 123 >", BadLength),
        ("< send 123 2 1 >", BadLength),
        ("< send 123 1 1 2 >", BadLength),
        ("< send 123 9 1 2 3 4 5 6 7 8 9 >", BadValue),
        ("< send 800 0 >", BadValue),
        ("< send 12345 0 >", BadValue),
        ("< send 123 1 100 >", BadValue),
        ("< send 12x 0 >", BadDigit),
        ("< send 123 1 x >", BadDigit),
        ("< send 123456789 0 >", BadDigit),
        ("< send 20000000 0 >", BadValue),
        ("< send 0000800 0 >", BadValue),
    ] {
        assert_eq!(one(element), Err(reason), "{element}");
    }
}

#[test]
fn elements_may_come_in_pieces() {
    let stream = b"< open can0 >< rawmode >\r\n< send 12 2 1 2 >  < echo >";
    let whole = read_in_pieces(stream, parsed);
    assert_eq!(whole.len(), 4);
    assert!(whole.iter().all(Result::is_ok), "{whole:?}");
}

#[test]
fn garbage_is_counted_once_and_an_element_cut_off_does_not_hide_the_next() {
    let garbage = Err(SocketcandReject::Garbage);
    assert_eq!(parsed(&mut Parser::default(), b"xyz > x< echo >abc"), [garbage, Ok(Command::Echo), garbage]);
    assert_eq!(parsed(&mut Parser::default(), b"< send 12< echo >"), [garbage, Ok(Command::Echo)]);
}

#[test]
fn an_element_too_long_is_refused_once_and_the_next_is_whole() {
    for (excess, refused) in [(0, SocketcandReject::UnknownCommand), (1, SocketcandReject::TooLong)] {
        let stream = format!("<{}>< echo >", "x".repeat(ELEMENT_MAX + excess));
        assert_eq!(parsed(&mut Parser::default(), stream.as_bytes()), [Err(refused), Ok(Command::Echo)], "{excess}");
    }
}

#[test]
fn a_million_random_bytes_are_refused_element_by_element() {
    let words: [&[u8]; 10] = [b"<", b">", b" ", b"send", b"12", b"1", b"0", b"echo", b"\xFF", b"open"];
    survives_random_words(&words, 500_000, parsed);
}
