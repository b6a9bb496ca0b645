//! Tests of [`super`]: files appear whole or not at all, and files of others are not touched.

use super::*;

fn names_in(directory: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn failed_write_leaves_only_the_old_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.txt");
    let bytes = write_file_atomically(&path, |out| out.write_all(b"first")).unwrap();
    assert_eq!(bytes, 5);
    let error = write_file_atomically(&path, |out| {
        out.write_all(b"second")?;
        Err(io::ErrorKind::StorageFull.into())
    });
    assert!(matches!(error, Err(SinkError::Write { .. })), "{error:?}");
    assert_eq!(fs::read(&path).unwrap(), b"first");
    assert_eq!(names_in(directory.path()), ["a.txt"]);
}

#[test]
fn a_file_is_replaced_whole() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.txt");
    write_file_atomically(&path, |out| out.write_all(b"a longer first text")).unwrap();
    write_file_atomically(&path, |out| out.write_all(b"second")).unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"second");
    assert_eq!(names_in(directory.path()), ["a.txt"]);
}

#[test]
fn a_missing_directory_or_a_directory_in_the_way_is_a_clear_error() {
    let directory = tempfile::tempdir().unwrap();
    let missing = directory.path().join("none/a.txt");
    let error = write_file_atomically(&missing, |_| Ok(())).unwrap_err().to_string();
    assert!(error.contains("none/a.txt") && error.contains("existing directory"), "{error}");
    write_file_atomically(directory.path(), |_| Ok(())).unwrap_err();
    write_file_atomically(Path::new("/"), |_| Ok(())).unwrap_err();
}

#[test]
fn new_file_with_a_taken_name_is_refused_and_the_first_stays() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.txt");
    assert_eq!(write_new_file(&path, |out| out.write_all(b"first")).unwrap(), 5);
    let error = write_new_file(&path, |out| out.write_all(b"second")).unwrap_err();
    assert!(matches!(&error, SinkError::NameTaken { .. }) && error.to_string().contains("a.txt"), "{error}");
    // The name is taken while the bytes are written.
    let late = directory.path().join("late.txt");
    let error = write_new_file(&late, |out| {
        fs::write(&late, "quicker")?;
        out.write_all(b"slower")
    });
    assert!(matches!(error, Err(SinkError::NameTaken { .. })), "{error:?}");
    assert_eq!((fs::read(&path).unwrap(), fs::read(&late).unwrap()), (b"first".to_vec(), b"quicker".to_vec()));
    assert_eq!(names_in(directory.path()), ["a.txt", "late.txt"], "no temporary file is left");
}

#[test]
fn new_file_is_as_readable_as_other_files_of_the_user() {
    use std::os::unix::fs::PermissionsExt;
    let directory = tempfile::tempdir().unwrap();
    let mode = |name: &str| fs::metadata(directory.path().join(name)).unwrap().permissions().mode();
    fs::write(directory.path().join("plain"), "").unwrap();
    write_new_file(&directory.path().join("ours"), |_| Ok(())).unwrap();
    assert_eq!(mode("ours"), mode("plain"));
}

#[test]
fn planted_link_pipe_or_folder_is_refused_without_a_wait_and_its_target_stays() {
    let directory = tempfile::tempdir().unwrap();
    let victim = directory.path().join("victim");
    fs::write(&victim, "precious").unwrap();
    let names = ["link", "pipe", "folder", "dangling"].map(|name| directory.path().join(name));
    std::os::unix::fs::symlink(&victim, &names[0]).unwrap();
    rustix::fs::mkfifoat(rustix::fs::CWD, &names[1], rustix::fs::Mode::RWXU).unwrap();
    fs::create_dir(&names[2]).unwrap();
    std::os::unix::fs::symlink(directory.path().join("nothing"), &names[3]).unwrap();
    for name in &names {
        let new = write_new_file(name, |out| out.write_all(b"frame"));
        assert!(matches!(new, Err(SinkError::NameTaken { .. })), "{}: {new:?}", name.display());
        let own = replace_own_file(name, |out| out.write_all(b"frame"));
        assert!(matches!(own, Err(SinkError::NameTaken { .. })), "{}: {own:?}", name.display());
    }
    assert_eq!(fs::read(&victim).unwrap(), b"precious");
    assert_eq!(names_in(directory.path()), ["dangling", "folder", "link", "pipe", "victim"], "nothing else was made");
    replace_own_file(&victim, |out| out.write_all(b"its own")).unwrap();
    assert_eq!(fs::read(&victim).unwrap(), b"its own", "control: a regular file is replaced");
}

#[test]
fn temporary_names_are_random() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("frame.fits");
    let made: Vec<NamedTempFile> = (0..50).map(|_| temporary_beside(&path).unwrap()).collect();
    let mut names = names_in(directory.path());
    names.dedup();
    assert_eq!(names.len(), 50);
    let process = format!("{}", std::process::id());
    assert!(names.iter().all(|name| name.starts_with(".frame.fits.") && name.ends_with(".part")), "{names:?}");
    assert!(!names.iter().all(|name| name.contains(&process)), "predictable: {names:?}");
    drop(made);
    assert!(names_in(directory.path()).is_empty(), "removed when dropped");
}

#[test]
fn a_full_device_is_an_error_and_is_not_replaced() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("full");
    symlink("/dev/full", &path).unwrap();
    let error = write_file_atomically(&path, |out| out.write_all(&[7; 100_000])).unwrap_err();
    assert!(
        matches!(&error, SinkError::Write { source, .. } if source.kind() == io::ErrorKind::StorageFull),
        "{error}"
    );
    assert!(fs::metadata("/dev/full").unwrap().file_type().is_char_device(), "the device is still a device");
    assert!(fs::symlink_metadata(&path).unwrap().is_symlink(), "the link is still a link");
}

#[test]
fn a_pipe_is_written_to_its_reader_and_without_one_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let pipe = directory.path().join("pipe");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RWXU).unwrap();
    let error = open_existing(&pipe, Duration::ZERO).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    assert!(error.to_string().contains("this pipe was without a reader"), "{error}");
    let path = pipe.clone();
    let reader = std::thread::Builder::new().name("reader".into()).spawn(move || fs::read(path)).unwrap();
    // More than a pipe holds: the writer waits for its reader.
    let bytes = write_file_atomically(&pipe, |out| out.write_all(&[7; 300_000])).unwrap();
    assert_eq!((bytes, reader.join().unwrap().unwrap().len()), (300_000, 300_000));
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo(), "the pipe is still a pipe");
}
