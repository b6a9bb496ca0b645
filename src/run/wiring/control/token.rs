//! The token of a control socket: only a program that may read the user's files may control the run.
//!
//! Any program and any web page on this machine can connect to a loopback port. So the first request of a connection
//! must carry 128 random bits of the operating system, which are printed, and written to a file that only the user may
//! read: `$XDG_RUNTIME_DIR/starloop/control-ADDRESS_PORT.token`, or `starloop-UID` in the folder for temporary files
//! instead of `$XDG_RUNTIME_DIR/starloop`. The file is removed at the end of the run. Tests: below.

use crate::wiring::control::lines::ControlAddress;
use base::refused::Refused;
use core::{fmt, hint::black_box};
use rand::{TryRng, rngs::SysRng};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Bytes of a token: 128 bit.
const BYTES: usize = 16;

/// A token; shown as 32 hexadecimal digits.
pub(super) struct Token {
    text: String,
}

impl Token {
    /// Returns a new token from the operating system's random numbers.
    pub(super) fn random() -> Result<Self, Refused> {
        let mut bytes = [0; BYTES];
        SysRng
            .try_fill_bytes(&mut bytes)
            .map_err(|error| Refused(format!("control socket: no random numbers for a token: {error}")))?;
        Ok(Self { text: bytes.iter().map(|byte| format!("{byte:02x}")).collect() })
    }

    /// Returns true when `text` is this token, in a time that does not depend on where the first difference is.
    pub(super) fn is(&self, text: &str) -> bool {
        let pairs = self.text.bytes().zip(text.bytes());
        let differences = pairs.fold(0, |all, (ours, theirs)| black_box(all | (ours ^ theirs)));
        self.text.len() == text.len() && black_box(differences) == 0
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// A file with a token, which is removed when this is dropped.
#[derive(Debug)]
pub(super) struct TokenFile {
    /// Path of the file.
    pub(super) path: PathBuf,
}

impl TokenFile {
    /// Writes the token of the socket at `address`, which the caller listens on.
    pub(super) fn write(token: &Token, address: ControlAddress) -> Result<Self, Refused> {
        Self::write_in(&folder(), token, address)
    }

    fn write_in(folder: &Path, token: &Token, address: ControlAddress) -> Result<Self, Refused> {
        let path = folder.join(file_name(address));
        let refuse = |source: io::Error| {
            Refused(format!("control socket: cannot write the token to {} ({source})", path.display()))
        };
        make_private(folder).map_err(refuse)?;
        // Only this user may use the folder, and the port is ours: a file of this name is left from a run that was
        // killed.
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(refuse(error)),
            Ok(()) | Err(_) => {}
        }
        let mut file: File = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&path).map_err(refuse)?;
        // From here on, dropping this removes the file.
        let written = Self { path: path.clone() };
        writeln!(file, "{token}").map_err(refuse)?;
        Ok(written)
    }
}

impl Drop for TokenFile {
    fn drop(&mut self) {
        let _somebody_may_have_removed_it = fs::remove_file(&self.path);
    }
}

/// Returns the folder of the user's tokens.
fn folder() -> PathBuf {
    match std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_absolute()) {
        Some(runtime) => runtime.join("starloop"),
        None => std::env::temp_dir().join(format!("starloop-{}", rustix::process::getuid().as_raw())),
    }
}

/// Returns the file name for an address: `control-127.0.0.1_40000.token`, or with `__1_40000` for `[::1]:40000`.
fn file_name(address: ControlAddress) -> String {
    let name = address.to_string().replace(['[', ']'], "").replace(':', "_");
    format!("control-{name}.token")
}

/// Makes a folder that only its owner may enter, or checks an existing one.
fn make_private(folder: &Path) -> io::Result<()> {
    match DirBuilder::new().mode(0o700).create(folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
        Ok(()) | Err(_) => {}
    }
    let found = fs::symlink_metadata(folder)?;
    let is_ours = found.is_dir() && found.uid() == rustix::process::getuid().as_raw() && found.mode() & 0o077 == 0;
    let refuse = || {
        let folder = folder.display();
        io::Error::new(
            ErrorKind::PermissionDenied,
            format!("{folder} must be a folder of this user with mode 0700; remove it, or set XDG_RUNTIME_DIR"),
        )
    };
    is_ours.then_some(()).ok_or_else(refuse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn address() -> ControlAddress {
        "127.0.0.1:40000".parse().unwrap()
    }

    #[test]
    fn tokens_differ_and_only_the_same_text_is_accepted() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        let text = one.to_string();
        assert!(text.len() == 32 && text.bytes().all(|digit| digit.is_ascii_hexdigit()), "{text}");
        assert!(one.is(&text) && !other.is(&text));
        let digit = if text.starts_with('0') { "1" } else { "0" };
        for wrong in ["", &text[..31], &format!("{text}0"), &format!("{digit}{}", &text[1..])] {
            assert!(!one.is(wrong), "{wrong}");
        }
    }

    #[test]
    fn the_file_is_readable_by_its_owner_only_and_removed_at_the_end() {
        let base = tempfile::tempdir().unwrap();
        let folder = base.path().join("starloop");
        let token = Token::random().unwrap();
        let written = TokenFile::write_in(&folder, &token, address()).unwrap();
        assert_eq!(written.path, folder.join("control-127.0.0.1_40000.token"));
        assert_eq!(fs::read_to_string(&written.path).unwrap(), format!("{token}\n"));
        for (path, mode) in [(&written.path, 0o600), (&folder, 0o700)] {
            assert_eq!(fs::metadata(path).unwrap().permissions().mode() & 0o777, mode, "{}", path.display());
        }
        let path = written.path.clone();
        drop(written);
        assert!(!path.exists());
        assert_eq!(file_name("[::1]:7".parse().unwrap()), "control-__1_7.token");
    }

    #[test]
    fn a_file_of_a_killed_run_is_replaced_and_a_link_is_not_followed() {
        let base = tempfile::tempdir().unwrap();
        let (folder, victim) = (base.path().join("starloop"), base.path().join("victim"));
        make_private(&folder).unwrap();
        fs::write(&victim, "precious").unwrap();
        std::os::unix::fs::symlink(&victim, folder.join(file_name(address()))).unwrap();
        let token = Token::random().unwrap();
        let written = TokenFile::write_in(&folder, &token, address()).unwrap();
        assert_eq!(fs::read_to_string(&victim).unwrap(), "precious");
        assert!(fs::symlink_metadata(&written.path).unwrap().is_file());
    }

    #[test]
    fn a_folder_that_others_may_enter_is_refused() {
        let base = tempfile::tempdir().unwrap();
        let open = base.path().join("open");
        fs::create_dir(&open).unwrap();
        fs::set_permissions(&open, fs::Permissions::from_mode(0o755)).unwrap();
        let link = base.path().join("link");
        std::os::unix::fs::symlink(base.path(), &link).unwrap();
        for folder in [open, link] {
            let error = TokenFile::write_in(&folder, &Token::random().unwrap(), address()).err().unwrap().to_string();
            assert!(error.contains("mode 0700") && error.contains(&folder.display().to_string()), "{error}");
        }
    }
}
