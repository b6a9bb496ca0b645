//! socketcand: any bytes in any chunks -> the commands and refusals that the protocol's grammar, written afresh, gives.

#![no_main]

use firmware_protocol::can::{CanFrame, CanId};
use libfuzzer_sys::fuzz_target;
use link::gateway::socketcand::{Command, ELEMENT_MAX, NAME_MAX, Parser, SocketcandReject};
use starloop_fuzz::{Input, input};

fuzz_target!(|bytes: &[u8]| {
    let mut rest = Input::new(bytes);
    let (chunks, stream) = (rest.array::<4>(), rest.rest());
    let whole = read_in(stream, &[u8::MAX]);
    assert_eq!(read_in(stream, &[0]), whole, "byte by byte");
    assert_eq!(read_in(stream, &chunks), whole, "in chunks of {chunks:?}");
    let wanted = expected(stream);
    assert_eq!(whole.len(), wanted.len(), "each element is a command or a counted refusal: {whole:?}");
    for (outcome, wanted) in whole.iter().zip(&wanted) {
        match (outcome, wanted) {
            (Ok(command), Ok(words)) => assert!(is_said(command, words), "{command:?} for {words:?}"),
            (Err(reason), Err(wanted)) => assert!(wanted.is_none_or(|wanted| wanted == *reason), "{reason:?}"),
            _ => panic!("got {outcome:?}, wanted {wanted:?}"),
        }
    }
    assert_takes_no_memory(stream);
});

fn read_in(stream: &[u8], lengths: &[u8]) -> Vec<Result<Command, SocketcandReject>> {
    input::read_in(stream, lengths, |parser: &mut Parser, chunk, all| parser.push(chunk, &mut |read| all.push(read)))
}

fn assert_takes_no_memory(stream: &[u8]) {
    let mut outcomes = 0_usize;
    let memory = allocation_counter::measure(|| Parser::default().push(stream, &mut |_| outcomes += 1));
    assert_eq!(memory.count_total, 0, "{outcomes} outcomes");
}

type Wanted<'a> = Result<Vec<&'a [u8]>, Option<SocketcandReject>>;

/// Returns the expected results of the stream, by splitting it at the brackets: words of commands, or refusals, by
/// their reason where only one is right.
fn expected(stream: &[u8]) -> Vec<Wanted<'_>> {
    let mut all = Vec::new();
    let mut pieces = stream.split(|byte| *byte == b'<');
    all.extend(between(pieces.next().unwrap_or(&[])));
    let mut pieces = pieces.peekable();
    while let Some(piece) = pieces.next() {
        let end = piece.iter().position(|byte| *byte == b'>');
        let element = &piece[..end.unwrap_or(piece.len())];
        if element.len() > ELEMENT_MAX {
            all.push(Err(Some(SocketcandReject::TooLong)));
        } else if end.is_some() {
            all.push(understood(element));
        } else if pieces.peek().is_some() {
            all.push(Err(Some(SocketcandReject::Garbage)));
        }
        all.extend(end.and_then(|end| between(&piece[end + 1..])));
    }
    all
}

/// Returns the refusal of text outside of brackets, which comes once unless the text is blank.
fn between(text: &[u8]) -> Option<Wanted<'_>> {
    let is_blank = |byte: &u8| b" \t\n\r\x0C\0".contains(byte);
    (!text.iter().all(is_blank)).then_some(Err(Some(SocketcandReject::Garbage)))
}

fn understood(element: &[u8]) -> Wanted<'_> {
    let is_space = |byte: &u8| b" \t\n\r\x0C".contains(byte);
    let words: Vec<&[u8]> = element.split(is_space).filter(|word| !word.is_empty()).collect();
    let is_right = match words.as_slice() {
        [b"open", name] => name.len() <= NAME_MAX,
        [b"rawmode"] | [b"echo"] => true,
        [b"send", id, length, data @ ..] => is_frame(id, length, data),
        _ => false,
    };
    if is_right { Ok(words) } else { Err(None) }
}

fn number(word: &[u8]) -> Option<u32> {
    let is_number = (1..=8).contains(&word.len()) && word.iter().all(u8::is_ascii_hexdigit);
    is_number.then(|| u32::from_str_radix(core::str::from_utf8(word).ok()?, 16).ok()).flatten()
}

fn is_frame(id: &[u8], length: &[u8], data: &[&[u8]]) -> bool {
    let most = if id.len() == 8 { 0x1FFF_FFFF } else { 0x7FF };
    let is_id = number(id).is_some_and(|id| id <= most);
    let is_length = number(length).is_some_and(|length| length as usize == data.len() && length <= 8);
    is_id && is_length && data.iter().all(|byte| number(byte).is_some_and(|byte| byte < 0x100))
}

fn is_said(command: &Command, words: &[&[u8]]) -> bool {
    match (command, words) {
        (Command::Open(name), [b"open", word]) => name.as_bytes() == *word,
        (Command::RawMode, [b"rawmode"]) | (Command::Echo, [b"echo"]) => true,
        (Command::Send(frame), [b"send", id, _, data @ ..]) => {
            let data: Vec<u8> = data.iter().filter_map(|byte| number(byte)?.try_into().ok()).collect();
            let of = |number: u32| if id.len() == 8 { CanId::extended(number) } else { CanId::from_flagged(number) };
            number(id).and_then(of).and_then(|id| CanFrame::classic(id, &data)) == Some(*frame)
        }
        _ => false,
    }
}
