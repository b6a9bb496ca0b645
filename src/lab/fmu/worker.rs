//! `starloop fmu --worker`: one instance, asked over a socket by the library in the simulator's process (`fmu_library`).
//!
//! Requests -> calls of [`Slave`] -> replies, until the socket closes. An error is a reply with its reason; a panic ends the
//! program, which the library reports.

use crate::error::FmuError;
use crate::protocol::{Kind, Operation, Reply, Request, Status, next_text, next_word, words};
use crate::slave::Slave;
use crate::values::{Place, Value};
use crate::variables::element_of;
use base::refused::Refused;
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;

/// Makes an instance and serves it until the other end has gone.
///
/// # Errors
/// When the other end says what makes no sense, or takes no reply.
pub fn serve(stream: &mut (impl Read + Write), resources: &Path, token: &str) -> io::Result<()> {
    let made = Slave::new(resources, token);
    let started = made.as_ref().map_or_else(refusal, |_slave| Reply::of(Status::Ok, ""));
    stream.write_all(&started.bytes())?;
    let Ok(mut slave) = made else { return Ok(()) };
    loop {
        let request = match Request::read(stream) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            read => read?,
        };
        let reply = answer(&mut slave, &request).unwrap_or_else(|error| refusal(&error));
        stream.write_all(&reply.bytes())?;
    }
}

fn refusal(error: &FmuError) -> Reply {
    Reply::of(Status::Error, &error.to_string())
}

fn answer(slave: &mut Slave, request: &Request) -> Result<Reply, FmuError> {
    let mut reply = Reply::of(Status::Ok, "");
    let time_s =
        |place: usize| request.content.as_chunks().0.get(place).map_or(f64::NAN, |word| f64::from_ne_bytes(*word));
    let references = request.head.as_chunks().0.iter().map(|word| u32::from_ne_bytes(*word));
    match request.code {
        Operation::Enter => slave.enter(time_s(0))?,
        Operation::Exit => slave.exit()?,
        Operation::Step => {
            slave.step(time_s(0), time_s(1))?;
            reply.content = words(&slave.time_s);
        }
        Operation::Terminate => {
            if let Some(lost) = slave.terminate()? {
                reply = Reply::of(Status::Warning, &lost);
            }
        }
        Operation::Reset => slave.reset(),
        Operation::Get(kind) => {
            for reference in references {
                let (variable, element) = element_of(reference);
                let got = slave.value(variable).and_then(|value| bytes_of(kind, value, element));
                reply.content.extend(got.ok_or_else(|| refuse(reference, &no_such(kind, "got")))?);
            }
        }
        Operation::Set(kind) => {
            let mut rest = request.content.as_slice();
            for reference in references {
                let (variable, element) = element_of(reference);
                let place = slave.place(variable).ok_or_else(|| no_such(kind, "set"));
                let set = place.and_then(|place| fill(kind, place, element, &mut rest));
                set.map_err(|why| refuse(reference, &why))?;
            }
            if !rest.is_empty() {
                return Err(Refused("got more values than the variables have together".into()).into());
            }
        }
    }
    Ok(reply)
}

fn refuse(reference: u32, why: &str) -> FmuError {
    Refused(format!("value reference {reference}: {why}")).into()
}

fn no_such(kind: Kind, done: &str) -> String {
    format!("wanted a variable of the type {kind:?} that can be {done} now")
}

/// Returns the bytes of a value, or of one element of it; `None` where it is of another type.
fn bytes_of(kind: Kind, value: Value<'_>, element: Option<usize>) -> Option<Vec<u8>> {
    Some(match (kind, value, element) {
        (Kind::Real, Value::Reals(numbers), None) => words(numbers),
        (Kind::Real, Value::Reals(numbers), Some(element)) => words(numbers.get(element..=element)?),
        (Kind::Whole, Value::Whole(number), None) => number.to_ne_bytes().into(),
        (Kind::Boolean, Value::Boolean(is_so), None) => i64::from(is_so).to_ne_bytes().into(),
        (Kind::Text, Value::Text(text), None) => [text.as_bytes(), &[0]].concat(),
        _other_type => return None,
    })
}

/// Sets a value, or one element of it, from the front of the content.
fn fill(kind: Kind, place: Place<'_>, element: Option<usize>, rest: &mut &[u8]) -> Result<(), String> {
    let none = || no_such(kind, "set");
    match (kind, place, element) {
        (Kind::Real, Place::Reals(numbers), element) => {
            let numbers = match element {
                Some(element) => numbers.get_mut(element..=element).ok_or_else(none)?,
                None => numbers,
            };
            for number in numbers {
                *number = finite(f64::from_ne_bytes(next_word(rest).ok_or(TOO_FEW)?))?;
            }
        }
        (Kind::Whole, Place::Short(number), None) => *number = whole(rest)?,
        (Kind::Whole, Place::Long(number), None) => *number = whole(rest)?,
        (Kind::Boolean, Place::Boolean(is_so), None) => *is_so = whole::<i64>(rest)? != 0,
        (Kind::Text, Place::Text(text), None) => {
            *text = next_text(rest).ok_or(TOO_FEW)?.to_str().map_err(|_| "wanted UTF-8")?.to_owned()
        }
        _other_type => return Err(none()),
    }
    Ok(())
}

fn finite(number: f64) -> Result<f64, String> {
    if number.is_finite() { Ok(number) } else { Err(format!("wanted finite numbers, got {number}")) }
}

fn whole<T: TryFrom<i64>>(rest: &mut &[u8]) -> Result<T, String> {
    let number = i64::from_ne_bytes(next_word(rest).ok_or(TOO_FEW)?);
    T::try_from(number).map_err(|_| format!("wanted a number that the variable's type holds, got {number}"))
}

const TOO_FEW: &str = "got fewer values than the variables have together";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::archive::{RUN_FILE, token};
    use crate::variables::{reference, scalars, variables};
    use std::os::unix::net::UnixStream;

    const BENCH: &str = "[timing]\nframe_rate_hz = 10\nduration_s = 1\nstart_utc = \"2026-03-01T12:00:00Z\"\n\
                         [link]\nkind = \"simulated\"\nwire = \"can_fd\"\n";

    fn request(code: Operation, references: &[u32], content: &[u8]) -> Request {
        let head = references.iter().flat_map(|reference| reference.to_ne_bytes()).collect();
        Request { code, head, content: content.into() }
    }

    /// Asks a worker; returns its replies after that of the start.
    fn replies(requests: &[Request]) -> Vec<Reply> {
        let folder = tempfile::tempdir().unwrap();
        let document = config::Document::from_text(BENCH, &folder.path().join("bench.toml"));
        let text = serde_json::to_string(&document.pack().unwrap()).unwrap();
        std::fs::write(folder.path().join(RUN_FILE), &text).unwrap();
        let (mut ours, mut theirs) = UnixStream::pair().unwrap();
        requests.iter().for_each(|request| ours.write_all(&request.bytes()).unwrap());
        ours.shutdown(std::net::Shutdown::Write).unwrap();
        serve(&mut theirs, folder.path(), &token(&text, 1)).unwrap();
        assert_eq!(Reply::read(&mut ours).unwrap(), Reply::of(Status::Ok, ""), "it has started");
        requests.iter().map(|_| Reply::read(&mut ours).unwrap()).collect()
    }

    #[test]
    fn an_array_is_set_as_a_whole_or_number_by_number() {
        let (get, set, rate) = (Operation::Get(Kind::Real), Operation::Set(Kind::Real), reference::RATE);
        let single: Vec<u32> = scalars(&variables(1))
            .iter()
            .filter(|variable| variable.name.starts_with("rate["))
            .map(|variable| variable.reference)
            .collect();
        let fourth = 2 * single[2] - single[1];
        let got = replies(&[
            request(set, &[rate], &words(&[0.1, -0.2, 0.3])),
            request(get, &single, &[]),
            request(set, &[single[2], single[0]], &words(&[3.0, 1.0])),
            request(get, &[rate], &[]),
            request(set, &[rate], &words(&[0.1, -0.2])),
            request(set, &[single[0]], &words(&[0.1, -0.2])),
            request(get, &[fourth], &[]),
        ]);
        assert_eq!((got[0].code, &got[1].content), (Status::Ok, &words(&[0.1, -0.2, 0.3])));
        assert_eq!((got[2].code, &got[3].content), (Status::Ok, &words(&[1.0, -0.2, 3.0])));
        for (reply, reason) in got[4..].iter().zip(["fewer values", "more values", "wanted a variable"]) {
            let said = String::from_utf8_lossy(&reply.head);
            assert!(reply.code == Status::Error && said.contains(reason), "{said}");
        }
    }

    #[test]
    fn calls_out_of_order_and_other_types_are_errors_with_a_reason() {
        let refused = [
            (request(Operation::Step, &[], &words(&[0.0, 0.1])), "DoStep"),
            (request(Operation::Get(Kind::Whole), &[reference::RATE], &[]), "value reference 11: wanted a variable"),
            (request(Operation::Get(Kind::Real), &[9999], &[]), "value reference 9999"),
            (request(Operation::Set(Kind::Real), &[reference::RATE], &words(&[f64::NAN; 3])), "finite"),
            (request(Operation::Set(Kind::Whole), &[reference::TRIGGER], &70_000_i64.to_ne_bytes()), "got 70000"),
            (request(Operation::Set(Kind::Text), &[reference::OUTPUT_DIR], b"no end"), "fewer values"),
        ];
        let got = replies(&refused.clone().map(|(request, _)| request));
        for (reply, (_, reason)) in got.iter().zip(refused) {
            let said = String::from_utf8_lossy(&reply.head);
            assert!(reply.code == Status::Error && said.contains(reason), "{said}: wanted {reason}");
        }
    }
}
