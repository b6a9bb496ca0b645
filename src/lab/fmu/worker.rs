//! `starloop fmu --worker`: one instance, asked over a socket by the library in the simulator's process (`fmu_library`).
//!
//! Requests -> calls of [`Slave`] -> replies, until the socket closes. An error is a reply with its reason; a panic ends the
//! program, which the library reports. FMI 2 has no arrays: there, a reference is that of an element ([`element_of`]).

use crate::description::FmiVersion;
use crate::error::FmuError;
use crate::protocol::{Kind, Operation, Reply, Status, read_request, read_selection, write_reply};
use crate::slave::Slave;
use crate::variables::element_of;
use base::refused::Refused;
use std::io::{self, Read, Write};
use std::path::Path;

/// Makes an instance and serves it until the other end has gone.
///
/// # Errors
/// When the other end says what makes no sense, or has gone in the middle.
pub fn serve(stream: &mut (impl Read + Write), version: FmiVersion, resources: &Path, token: &str) -> io::Result<()> {
    let mut slave = match Slave::new(resources, token) {
        Ok(slave) => slave,
        Err(error) => return write_reply(stream, &Reply::of(Status::Error, error.to_string())),
    };
    write_reply(stream, &Reply::of(Status::Ok, ""))?;
    while let Some((operation, content)) = read_request(stream)? {
        let answer = answer(&mut slave, version, operation, &content);
        let reply = answer.unwrap_or_else(|error| Reply::of(Status::Error, error.to_string()));
        write_reply(stream, &reply)?;
    }
    Ok(())
}

fn answer(slave: &mut Slave, version: FmiVersion, operation: Operation, content: &[u8]) -> Result<Reply, FmuError> {
    let done = Reply::of(Status::Ok, "");
    let number =
        |place: usize| content.as_chunks::<8>().0.get(place).map_or(f64::NAN, |word| f64::from_ne_bytes(*word));
    match operation {
        Operation::Enter => slave.enter(number(0))?,
        Operation::Exit => slave.exit()?,
        Operation::Step => {
            slave.step(number(0), number(1))?;
            return Ok(Reply { content: slave.time_s().to_ne_bytes().to_vec(), ..done });
        }
        Operation::Terminate => {
            let lost = slave.terminate()?;
            return Ok(lost.map_or(done, |lost| Reply::of(Status::Warning, lost)));
        }
        Operation::Reset => slave.reset(),
        Operation::Get => return Ok(Reply { content: get(slave, version, content)?, ..done }),
        Operation::Set => set(slave, version, content)?,
    }
    Ok(done)
}

/// Returns the reference of a variable as this crate has it, and which element of it is meant; `None`: all of them.
fn place(version: FmiVersion, reference: u32) -> (u32, Option<usize>) {
    match version {
        FmiVersion::Three => (reference, None),
        FmiVersion::Two => {
            let (array, element) = element_of(reference);
            (array, Some(element))
        }
    }
}

/// Returns the reference of a single value.
fn single(version: FmiVersion, reference: u32) -> Option<u32> {
    let (of_variable, element) = place(version, reference);
    element.is_none_or(|element| element == 0).then_some(of_variable)
}

fn no_such(reference: u32, kind: Kind) -> FmuError {
    Refused(format!(
        "value reference {reference} belongs to no variable of the type {kind:?} that can be got or set now"
    ))
    .into()
}

fn get(slave: &Slave, version: FmiVersion, content: &[u8]) -> Result<Vec<u8>, FmuError> {
    let (kind, references, _) = read_selection(content).ok_or_else(garbled)?;
    let mut out = Vec::new();
    for reference in references {
        let of_variable = single(version, reference);
        let whole = |value: i128| i64::try_from(value).ok().map(|value| value.to_ne_bytes().to_vec());
        let bytes = match kind {
            Kind::Real => reals(slave, version, reference),
            Kind::Whole => of_variable.and_then(|place| slave.whole(place)).and_then(whole),
            Kind::Boolean => of_variable.and_then(|place| slave.boolean(place)).and_then(|value| whole(value.into())),
            Kind::Text => of_variable.and_then(|place| slave.text(place)).map(|text| [text.as_bytes(), &[0]].concat()),
        };
        out.extend(bytes.ok_or_else(|| no_such(reference, kind))?);
    }
    Ok(out)
}

fn reals(slave: &Slave, version: FmiVersion, reference: u32) -> Option<Vec<u8>> {
    let (array, element) = place(version, reference);
    let numbers = slave.float64(array)?;
    let numbers = match element {
        Some(element) => numbers.get(element..=element)?,
        None => numbers,
    };
    Some(numbers.iter().flat_map(|number| number.to_ne_bytes()).collect())
}

fn set(slave: &mut Slave, version: FmiVersion, content: &[u8]) -> Result<(), FmuError> {
    let (kind, references, mut rest) = read_selection(content).ok_or_else(garbled)?;
    for reference in references {
        let is_set = match kind {
            Kind::Real => {
                let into = reals_input(slave, version, reference).ok_or_else(|| no_such(reference, kind))?;
                for number in into {
                    *number = finite(f64::from_ne_bytes(next_word(&mut rest)?), reference)?;
                }
                true
            }
            Kind::Whole | Kind::Boolean => {
                let value = i64::from_ne_bytes(next_word(&mut rest)?);
                let of_variable = single(version, reference);
                of_variable.is_some_and(|place| match kind {
                    Kind::Boolean => slave.set_boolean(place, value != 0),
                    _whole => u32::try_from(value).is_ok_and(|value| slave.set_whole(place, value)),
                })
            }
            Kind::Text => {
                let text = next_text(&mut rest)?;
                single(version, reference).is_some_and(|place| slave.set_text(place, text))
            }
        };
        if !is_set {
            return Err(no_such(reference, kind));
        }
    }
    if rest.is_empty() { Ok(()) } else { Err(too_many()) }
}

fn reals_input(slave: &mut Slave, version: FmiVersion, reference: u32) -> Option<&mut [f64]> {
    let (array, element) = place(version, reference);
    let numbers = slave.float64_input(array)?;
    match element {
        Some(element) => numbers.get_mut(element..=element),
        None => Some(numbers),
    }
}

fn finite(number: f64, reference: u32) -> Result<f64, FmuError> {
    let refused = || Refused(format!("value reference {reference}: wanted finite numbers, got {number}")).into();
    number.is_finite().then_some(number).ok_or_else(refused)
}

fn next_word(rest: &mut &[u8]) -> Result<[u8; 8], FmuError> {
    let (word, others) = rest.split_first_chunk::<8>().ok_or_else(too_few)?;
    *rest = others;
    Ok(*word)
}

fn next_text<'a>(rest: &mut &'a [u8]) -> Result<&'a str, FmuError> {
    let end = rest.iter().position(|byte| *byte == 0).ok_or_else(too_few)?;
    let (text, others) = rest.split_at(end);
    *rest = others.get(1..).unwrap_or_default();
    core::str::from_utf8(text).map_err(|_| garbled())
}

fn too_few() -> FmuError {
    Refused("got fewer values than the variables have together".into()).into()
}

fn too_many() -> FmuError {
    Refused("got more values than the variables have together".into()).into()
}

fn garbled() -> FmuError {
    Refused("a request that makes no sense: the library and the program are not of one unit".into()).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::archive::{RUN_FILE, token};
    use crate::protocol::{read_reply, request, selection};
    use crate::variables::reference;
    use std::os::unix::net::UnixStream;

    const BENCH: &str = "[timing]\nframe_rate_hz = 10\nduration_s = 1\nstart_utc = \"2026-03-01T12:00:00Z\"\n\
                         [link]\nkind = \"simulated\"\nwire = \"can_fd\"\n";

    /// Asks a worker of a version; returns its replies, the first of which is that of the start.
    fn replies(version: FmiVersion, requests: &[(Operation, Vec<u8>)]) -> Vec<Reply> {
        let folder = tempfile::tempdir().unwrap();
        let document = config::Document::from_text(BENCH, &folder.path().join("bench.toml"));
        let text = serde_json::to_string(&document.pack().unwrap()).unwrap();
        std::fs::write(folder.path().join(RUN_FILE), &text).unwrap();
        let (mut ours, mut theirs) = UnixStream::pair().unwrap();
        for (operation, content) in requests {
            ours.write_all(&request(*operation, content)).unwrap();
        }
        ours.shutdown(std::net::Shutdown::Write).unwrap();
        serve(&mut theirs, version, folder.path(), &token(&text, 1)).unwrap();
        drop(theirs);
        core::iter::from_fn(|| read_reply(&mut ours).unwrap()).collect()
    }

    fn words(numbers: &[f64]) -> Vec<u8> {
        numbers.iter().flat_map(|number| number.to_ne_bytes()).collect()
    }

    #[test]
    fn an_array_is_set_as_a_whole_or_number_by_number() {
        let (rate, set) = (reference::RATE, [0.1, -0.2, 0.3]);
        let whole = selection(Kind::Real, &[rate]);
        let three = [
            (Operation::Set, [whole.clone(), words(&set)].concat()),
            (Operation::Get, whole.clone()),
            (Operation::Set, [whole.clone(), words(&set[..2])].concat()),
        ];
        let got = replies(FmiVersion::Three, &three);
        assert_eq!((got[2].status, &got[2].content), (Status::Ok, &words(&set)));
        assert!(got[3].status == Status::Error && got[3].message.contains("fewer values"), "{:?}", got[3]);
        let single = selection(Kind::Real, &[8 * rate + 2, 8 * rate]);
        let two = [
            (Operation::Set, [single.clone(), words(&[0.3, 0.1])].concat()),
            (Operation::Get, selection(Kind::Real, &[8 * rate, 8 * rate + 1, 8 * rate + 2])),
            (Operation::Get, selection(Kind::Real, &[8 * rate + 3])),
        ];
        let got = replies(FmiVersion::Two, &two);
        assert_eq!(got[2].content, words(&[0.1, 0.0, 0.3]));
        assert_eq!(got[3].status, Status::Error, "a fourth of three");
    }

    #[test]
    fn calls_out_of_order_and_other_types_are_errors_with_a_reason() {
        let refused = [
            (Operation::Step, words(&[0.0, 0.1])),
            (Operation::Get, selection(Kind::Whole, &[reference::RATE])),
            (Operation::Set, [selection(Kind::Real, &[reference::RATE]), words(&[f64::NAN; 3])].concat()),
            (Operation::Get, vec![9]),
        ];
        let got = replies(FmiVersion::Three, &refused);
        assert_eq!(got[0], Reply::of(Status::Ok, ""), "control: it has started");
        let reasons = ["DoStep", "value reference 11", "finite", "makes no sense"];
        for (reply, reason) in got[1..].iter().zip(reasons) {
            assert!(reply.status == Status::Error && reply.message.contains(reason), "{reply:?}");
        }
    }
}
