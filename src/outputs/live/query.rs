//! The queries in the address, after the question mark.
//!
//! Unknown and repeated keys and values out of range are refused with what was wanted. Nothing is decoded: no valid
//! value needs it. Tests: below.

use crate::live::picture::Scale;
use core::str::FromStr;

/// An invalid query; the text is for the client.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: got \"{got}\", wanted {wanted}")]
pub(super) struct BadQuery {
    key: &'static str,
    got: String,
    wanted: &'static str,
}

fn bad(key: &'static str, got: &str, wanted: &'static str) -> BadQuery {
    BadQuery { key, got: got.chars().take(64).collect(), wanted }
}

/// Reads `head` alone, a head's number: 0 where it is left out.
pub(super) fn head(query: &str) -> Result<usize, BadQuery> {
    let [head] = values(query, ["head"])?;
    head_number(head)
}

/// Form of a frame's number.
const FRAME: &str = "a frame's number, as in the answer to /frame.png";

/// A picture, as requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PictureQuery {
    /// Number of the head.
    pub(super) head: usize,
    /// Number of a kept frame; `None`: the newest.
    pub(super) frame: Option<u32>,
    /// Grey scale.
    pub(super) scale: Scale,
}

/// Reads `head`, `frame`, and `stretch` with `black` and `white` for `dn`.
pub(super) fn picture(query: &str) -> Result<PictureQuery, BadQuery> {
    let [head, frame, stretch, black, white] = values(query, ["head", "frame", "stretch", "black", "white"])?;
    let frame = frame.map(|text| number("frame", Some(text), FRAME)).transpose()?;
    Ok(PictureQuery { head: head_number(head)?, frame, scale: scale([stretch, black, white])? })
}

/// Reads `head`, `frame`, and `x` and `y`, a pixel's column and row.
pub(super) fn pixel(query: &str) -> Result<(usize, u32, [usize; 2]), BadQuery> {
    let [head, frame, x, y] = values(query, ["head", "frame", "x", "y"])?;
    let place = |key, value| number(key, value, "a column or row of the frame, from 0");
    Ok((head_number(head)?, number("frame", frame, FRAME)?, [place("x", x)?, place("y", y)?]))
}

/// Reads `head`, and `frame`, a frame's number.
pub(super) fn head_and_frame(query: &str) -> Result<(usize, u32), BadQuery> {
    let [head, frame] = values(query, ["head", "frame"])?;
    Ok((head_number(head)?, number("frame", frame, FRAME)?))
}

fn head_number(head: Option<&str>) -> Result<usize, BadQuery> {
    head.map_or(Ok(0), |text| {
        number("head", Some(text), "a head's number, from 0, as in the list heads of /state.json")
    })
}

fn scale([stretch, black, white]: [Option<&str>; 3]) -> Result<Scale, BadQuery> {
    if stretch == Some("dn") {
        let dn = |key, value: Option<&str>| number::<u16>(key, value, "a DN from 0 to 65535");
        let (black, white) = (dn("black", black)?, dn("white", white)?);
        let text = white.to_string();
        return if black < white {
            Ok(Scale::Dn { black, white })
        } else {
            Err(bad("white", &text, "a DN greater than black"))
        };
    }
    if let Some((key, got)) = [("black", black), ("white", white)].into_iter().find_map(|(k, v)| Some((k, v?))) {
        return Err(bad(key, got, "it with stretch=dn only"));
    }
    let Some(name) = stretch else { return Ok(Scale::Stars) };
    let named = Scale::NAMED.iter().find(|(_, known)| *known == name);
    named.map(|(scale, _)| *scale).ok_or_else(|| bad("stretch", name, "stars, faint, linear, log or dn"))
}

fn number<T: FromStr>(key: &'static str, value: Option<&str>, wanted: &'static str) -> Result<T, BadQuery> {
    let got = value.unwrap_or("");
    got.parse().map_err(|_| bad(key, got, wanted))
}

/// Returns the values of the keys, in their order.
fn values<'a, const N: usize>(query: &'a str, keys: [&'static str; N]) -> Result<[Option<&'a str>; N], BadQuery> {
    let mut found = [None; N];
    for part in query.split('&').filter(|part| !part.is_empty()) {
        let (key, value) = part.split_once('=').unwrap_or((part, ""));
        let place = keys.iter().position(|known| *known == key);
        let place = place.ok_or_else(|| bad("key", key, "one that this address knows"))?;
        if found[place].replace(value).is_some() {
            return Err(bad(keys[place], value, "it once"));
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_read() {
        for (query, wanted) in [
            ("", Scale::Stars),
            ("stretch=stars", Scale::Stars),
            ("stretch=log&", Scale::Log),
            ("white=65535&stretch=dn&black=0", Scale::Dn { black: 0, white: 65_535 }),
        ] {
            assert_eq!(picture(query), Ok(PictureQuery { head: 0, frame: None, scale: wanted }), "{query}");
        }
    }

    #[test]
    fn invalid_queries_are_refused_with_the_wanted_form() {
        for (query, part) in [
            ("stretch=nice", "wanted stars, faint"),
            ("stretch", "got \"\""),
            ("stretch=log&stretch=log", "once"),
            ("stretch=log&black=3", "stretch=dn only"),
            ("stretch=dn&black=3", "white: got \"\""),
            ("stretch=dn&black=3&white=65536", "65535"),
            ("stretch=dn&black=3&white=3", "greater than black"),
            ("colour=1", "key: got \"colour\""),
            ("frame=", "wanted a frame's number"),
        ] {
            let error = picture(query).unwrap_err().to_string();
            assert!(error.contains(part), "{query}: {error}");
        }
        assert_eq!(head_and_frame("frame=7"), Ok((0, 7)));
        for query in ["", "frame=-1", "frame=4294967296", "frame=7&frame=7", "head=1"] {
            head_and_frame(query).unwrap_err();
        }
        let long = picture(&format!("stretch={}", "x".repeat(9_000))).unwrap_err();
        assert!(long.to_string().len() < 200, "what comes back is short: {long}");
    }

    #[test]
    fn head_is_read_wherever_it_is_asked_for() {
        assert_eq!((head(""), head("head=2")), (Ok(0), Ok(2)));
        let wanted = PictureQuery { head: 1, frame: Some(7), scale: Scale::Log };
        assert_eq!(picture("stretch=log&head=1&frame=7"), Ok(wanted));
        assert_eq!(pixel("y=3&x=2&head=1&frame=7"), Ok((1, 7, [2, 3])));
        for query in ["frame=7&x=2", "frame=7&x=-1&y=0", "x=1&y=1", "frame=7&x=1.5&y=0"] {
            pixel(query).unwrap_err();
        }
        assert_eq!(head_and_frame("head=1&frame=7"), Ok((1, 7)));
        for (query, part) in [
            ("head=", "head: got \"\""),
            ("head=-1", "wanted a head's number"),
            ("head=one", "got \"one\""),
            ("head=0&head=0", "once"),
            ("haed=1", "key: got \"haed\""),
        ] {
            let error = head(query).unwrap_err().to_string();
            assert!(error.contains(part), "{query}: {error}");
        }
    }
}
