//! slcan: any bytes in any chunks -> the commands and refusals that the manual's grammar, written afresh, gives.

#![no_main]

use libfuzzer_sys::fuzz_target;
use link::gateway::slcan::{Command, LINE_MAX, Parser, SlcanReject};
use starloop_fuzz::{Input, input};

const DATA_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

fuzz_target!(|bytes: &[u8]| {
    let mut rest = Input::new(bytes);
    let (chunks, stream) = (rest.array::<4>(), rest.rest());
    let whole = read_in(stream, &[u8::MAX]);
    assert_eq!(read_in(stream, &[0]), whole, "byte by byte");
    assert_eq!(read_in(stream, &chunks), whole, "in chunks of {chunks:?}");
    let wanted = expected(stream);
    assert_eq!(whole.len(), wanted.len(), "each line is a command or a counted refusal: {whole:?}");
    for (outcome, wanted) in whole.iter().zip(&wanted) {
        match (outcome, wanted) {
            (Ok(command), Ok(line)) => assert_eq!(&shown(command), line),
            (Err(reason), Err(wanted)) => assert!(wanted.is_none_or(|wanted| wanted == *reason), "{reason:?}"),
            _ => panic!("got {outcome:?}, wanted {wanted:?}"),
        }
    }
    assert_takes_no_memory(stream);
});

fn read_in(stream: &[u8], lengths: &[u8]) -> Vec<Result<Command, SlcanReject>> {
    input::read_in(stream, lengths, |parser: &mut Parser, chunk, all| parser.push(chunk, &mut |read| all.push(read)))
}

fn assert_takes_no_memory(stream: &[u8]) {
    let mut outcomes = 0_usize;
    let memory = allocation_counter::measure(|| Parser::default().push(stream, &mut |_| outcomes += 1));
    assert_eq!(memory.count_total, 0, "{outcomes} outcomes");
}

type Wanted = Result<String, Option<SlcanReject>>;

/// Returns the expected result of each line: a command's plain text, or a refusal, by its reason where only one is
/// right.
fn expected(stream: &[u8]) -> Vec<Wanted> {
    let mut lines: Vec<&[u8]> = stream.split(|byte| *byte == b'\r').collect();
    let unfinished = lines.pop().unwrap_or(&[]);
    let begin = |line: &[u8]| line.iter().position(|byte| *byte != b'\n').unwrap_or(line.len());
    let lines = lines.into_iter().map(|line| (&line[begin(line)..], true));
    let all = lines.chain([(&unfinished[begin(unfinished)..], false)]);
    all.filter_map(|(line, is_finished)| match line {
        line if line.len() > LINE_MAX => Some(Err(Some(SlcanReject::TooLong))),
        [letter, rest @ ..] if is_finished => Some(understood(*letter, rest)),
        _ => None,
    })
    .collect()
}

/// Returns the command's text with upper-case digits, `b` for `d` and `B` for `D`.
fn understood(letter: u8, rest: &[u8]) -> Wanted {
    let digits = rest.iter().all(u8::is_ascii_hexdigit).then(|| String::from_utf8_lossy(rest).to_uppercase());
    let is_one_of = |choice: &[u8]| matches!(rest, [one] if choice.contains(one));
    let is_right = match letter {
        b'O' | b'L' | b'C' | b'V' | b'v' | b'N' | b'F' => rest.is_empty(),
        b'S' | b'Y' => is_one_of(b"012345678"),
        b'Z' => is_one_of(b"01"),
        b'M' => is_one_of(b"01") || (digits.is_some() && rest.len() == 8),
        b'm' => digits.is_some() && rest.len() == 8,
        b't' | b'd' | b'b' => digits.as_deref().is_some_and(|digits| is_frame(digits, "7FF", letter == b't')),
        b'T' | b'D' | b'B' => digits.as_deref().is_some_and(|digits| is_frame(digits, "1FFFFFFF", letter == b'T')),
        b'r' | b'R' => return Err(Some(SlcanReject::RemoteRequest)),
        _ => return Err(Some(SlcanReject::UnknownCommand)),
    };
    let letter = match letter {
        b'd' => 'b',
        b'D' => 'B',
        other => char::from(other),
    };
    digits.filter(|_| is_right).map(|digits| format!("{letter}{digits}")).ok_or(None)
}

fn is_frame(digits: &str, highest_id: &str, is_classic: bool) -> bool {
    let Some((id, rest)) = digits.split_at_checked(highest_id.len()) else { return false };
    let Some(code) = rest.chars().next().and_then(|code| code.to_digit(16)) else { return false };
    id <= highest_id && (code <= 8 || !is_classic) && rest.len() == 1 + 2 * DATA_LENGTHS[code as usize]
}

/// Returns a command as text.
fn shown(command: &Command) -> String {
    match command {
        Command::Open => "O".into(),
        Command::ListenOnly => "L".into(),
        Command::Close => "C".into(),
        Command::BitRate(code) => format!("S{code}"),
        Command::DataBitRate(code) => format!("Y{code}"),
        Command::Version => "V".into(),
        Command::FirmwareVersion => "v".into(),
        Command::SerialNumber => "N".into(),
        Command::Flags => "F".into(),
        Command::AcceptanceCode(code) => format!("M{code:08X}"),
        Command::AcceptanceMask(mask) => format!("m{mask:08X}"),
        Command::Silent(on) => format!("M{}", u8::from(*on)),
        Command::TimeStamps(on) => format!("Z{}", u8::from(*on)),
        Command::Send(frame) => {
            let code = DATA_LENGTHS.iter().position(|length| *length == frame.data().len());
            let data: String = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
            let letter = match (frame.is_fd(), frame.id().is_extended()) {
                (false, false) => 't',
                (false, true) => 'T',
                (true, false) => 'b',
                (true, true) => 'B',
            };
            format!("{letter}{:X}{:X}{data}", frame.id(), code.expect("frames have such lengths only"))
        }
    }
}
