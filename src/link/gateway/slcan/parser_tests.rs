//! Every letter, both sides of every length, and lines that come in pieces.

use super::*;
use crate::gateway::parser_checks::{read_in_pieces, survives_random_words};
use firmware_protocol::can::ToCanId;

type Outcome = Result<Command, SlcanReject>;

fn parsed(parser: &mut Parser, bytes: &[u8]) -> Vec<Outcome> {
    let mut all = Vec::new();
    parser.push(bytes, &mut |outcome| all.push(outcome));
    all
}

fn one(line: &str) -> Outcome {
    let all = parsed(&mut Parser::default(), format!("{line}\r").as_bytes());
    assert_eq!(all.len(), 1, "{line}: {all:?}");
    all[0]
}

fn classic(id: impl ToCanId, data: &[u8]) -> Outcome {
    Ok(Command::Send(CanFrame::classic(id, data).unwrap()))
}

fn fd(id: impl ToCanId, data: &[u8]) -> Outcome {
    Ok(Command::Send(CanFrame::fd(id, data).unwrap()))
}

#[test]
fn every_command_is_understood() {
    for (line, command) in [
        ("O", Command::Open),
        ("L", Command::ListenOnly),
        ("C", Command::Close),
        ("S0", Command::BitRate(0)),
        ("S8", Command::BitRate(8)),
        ("Y5", Command::DataBitRate(5)),
        ("V", Command::Version),
        ("v", Command::FirmwareVersion),
        ("N", Command::SerialNumber),
        ("F", Command::Flags),
        ("M00abCDef", Command::AcceptanceCode(0x00AB_CDEF)),
        ("mFFFFFFFF", Command::AcceptanceMask(u32::MAX)),
        ("M0", Command::Silent(false)),
        ("M1", Command::Silent(true)),
        ("Z0", Command::TimeStamps(false)),
        ("Z1", Command::TimeStamps(true)),
    ] {
        assert_eq!(one(line), Ok(command), "{line}");
    }
}

#[test]
fn frames_have_their_identifier_length_and_bytes() {
    assert_eq!(one("t1230"), classic(0x123, &[]));
    assert_eq!(one("t7FF8001122334455667F"), classic(0x7FF, &[0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x7F]));
    assert_eq!(one("t00a1fE"), classic(0x00A, &[0xFE]), "either case");
    for (code, length) in [('8', 8), ('9', 12), ('A', 16), ('b', 20), ('C', 24), ('D', 32), ('E', 48), ('F', 64)] {
        let data = "5A".repeat(length);
        assert_eq!(one(&format!("d301{code}{data}")), fd(0x301, &vec![0x5A; length]), "{code}");
        assert_eq!(one(&format!("b301{code}{data}")), fd(0x301, &vec![0x5A; length]), "{code}");
        assert_eq!(one(&format!("b301{code}{data}0")), Err(SlcanReject::BadLength), "a digit more");
        assert_eq!(one(&format!("b301{code}{}", &data[1..])), Err(SlcanReject::BadLength), "a digit less");
    }
}

#[test]
fn capital_letters_have_identifiers_of_29_bits() {
    let id = |number| CanId::extended(number).unwrap();
    assert_eq!(one("T000001232AABB"), classic(id(0x123), &[0xAA, 0xBB]));
    assert_ne!(one("T000001232AABB"), one("t1232AABB"), "another identifier");
    assert_eq!(one("T1fFFffFF0"), classic(id(0x1FFF_FFFF), &[]));
    for letter in ["D", "B"] {
        assert_eq!(one(&format!("{letter}18FF12349{}", "5A".repeat(12))), fd(id(0x18FF_1234), &[0x5A; 12]));
        assert_eq!(one(&format!("{letter}00000123F{}", "01".repeat(64))), fd(id(0x123), &[1; 64]), "the longest line");
    }
}

#[test]
fn malformed_lines_are_refused_by_reason() {
    use SlcanReject::*;
    for (line, reason) in [
        ("Q", UnknownCommand),
        ("\u{e9}", UnknownCommand),
        ("O1", BadLength),
        ("S", BadLength),
        ("S10", BadLength),
        ("S9", BadValue),
        ("Sx", BadDigit),
        ("Z2", BadValue),
        ("M2", BadValue),
        ("M0000000", BadLength),
        ("m0000000g", BadDigit),
        ("t", BadLength),
        ("t123", BadLength),
        ("t8000", BadValue),
        ("t12x0", BadDigit),
        ("t123x", BadDigit),
        ("t1239", BadValue),
        ("t1231", BadLength),
        ("t12311", BadLength),
        ("t12311g", BadDigit),
        ("t1231111", BadLength),
        ("T1230", BadLength),
        ("T0000012", BadLength),
        ("T00000123", BadLength),
        ("T000001231", BadLength),
        ("T200000000", BadValue),
        ("TFFFFFFFF0", BadValue),
        ("T000001239", BadValue),
        ("T0000x1230", BadDigit),
        ("D000001231", BadLength),
        ("B200001230", BadValue),
        ("r1230", RemoteRequest),
        ("R000001230", RemoteRequest),
    ] {
        assert_eq!(one(line), Err(reason), "{line}");
    }
}

#[test]
fn lines_may_come_in_pieces_and_empty_ones_say_nothing() {
    let stream = b"\r\rC\r\nS6\rO\rt1232AABB\r\rd30190102030405060708090A0B0C\r";
    assert_eq!(read_in_pieces(stream, parsed).len(), 5);
}

#[test]
fn a_line_too_long_is_refused_once_and_the_next_is_whole() {
    for (excess, refused) in [(0, SlcanReject::BadLength), (1, SlcanReject::TooLong), (5000, SlcanReject::TooLong)] {
        let mut stream = vec![b'D'; LINE_MAX + excess];
        stream.extend_from_slice(b"\rO\r");
        assert_eq!(parsed(&mut Parser::default(), &stream), [Err(refused), Ok(Command::Open)], "{excess}");
    }
}

#[test]
fn a_million_random_bytes_are_refused_line_by_line() {
    let alphabet = b"0123456789ABCDEFtTdDbBrROLCSVvNFMmZY\r\n\x07\xFF";
    let letters: Vec<&[u8]> = alphabet.chunks(1).collect();
    survives_random_words(&letters, 1_000_000, parsed);
}
