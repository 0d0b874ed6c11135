use std::fs;
use std::path::Path;
use std::process::Command;

use super::*;

/// Small segments: about three of the records below.
const SMALL: u64 = 300;

fn open(folder: &Path, position: u64) -> Result<Episodes, Error> {
    Episodes::open_segmented(folder.join("replay"), position, SMALL)
}

/// Between 0 and 199 bytes that are different for every number.
fn record(number: u64) -> Vec<u8> {
    (0..number * 37 % 200).map(|i| (number * 31 + i) as u8).collect()
}

fn append(episodes: &mut Episodes, numbers: std::ops::Range<u64>) {
    for number in numbers {
        assert_eq!(episodes.position(), number);
        episodes.append(&record(number)).unwrap();
    }
}

fn assert_holds(episodes: &Episodes, numbers: std::ops::Range<u64>) {
    let mut buffer = Vec::new();
    for number in numbers.rev() {
        assert_eq!(episodes.read(number, &mut buffer).unwrap(), record(number), "record {number}");
    }
}

fn files_in(folder: &Path) -> Vec<String> {
    files::names(&folder.join("replay")).unwrap()
}

#[test]
fn records_are_read_back_in_any_order_from_all_segments() {
    let tmp = tempfile::tempdir().unwrap();
    let mut episodes = open(tmp.path(), 0).unwrap();
    assert_eq!((episodes.position(), episodes.oldest()), (0, 0));
    append(&mut episodes, 0..20);
    assert_holds(&episodes, 0..20);
    assert!(files_in(tmp.path()).len() > 3);
    assert_eq!(files_in(tmp.path())[0], "episodes-000000000000.bin");
    assert_eq!(episodes.sync().unwrap(), 20);
    drop(episodes);

    let mut episodes = open(tmp.path(), 20).unwrap();
    assert_holds(&episodes, 0..20);
    append(&mut episodes, 20..25);
    assert_holds(&episodes, 0..25);
}

#[test]
fn a_segment_is_the_records_with_their_lengths_and_checksums() {
    let tmp = tempfile::tempdir().unwrap();
    let mut episodes = open(tmp.path(), 0).unwrap();
    episodes.append(b"one").unwrap();
    episodes.append(b"").unwrap();
    let sum = |bytes: &[u8]| blake3::hash(bytes).as_bytes()[..8].to_vec();
    let expected = [
        3u64.to_le_bytes().to_vec(),
        sum(b"\0\0\0\0\0\0\0\0one"),
        b"one".to_vec(),
        0u64.to_le_bytes().to_vec(),
        sum(b"\x01\0\0\0\0\0\0\0"),
    ];
    let found = fs::read(tmp.path().join("replay/episodes-000000000000.bin")).unwrap();
    assert_eq!(found, expected.concat());
}

#[test]
fn going_back_to_any_earlier_position_and_on_again_gives_the_same_files() {
    let undisturbed = tempfile::tempdir().unwrap();
    append(&mut open(undisturbed.path(), 0).unwrap(), 0..20);
    let contents = |folder: &Path| -> Vec<Vec<u8>> {
        let read = |name: &String| fs::read(folder.join("replay").join(name)).unwrap();
        files_in(folder).iter().map(read).collect()
    };
    for position in 0..=20 {
        let tmp = tempfile::tempdir().unwrap();
        append(&mut open(tmp.path(), 0).unwrap(), 0..20);
        let mut episodes = open(tmp.path(), position).unwrap();
        assert_eq!(episodes.position(), position);
        assert_holds(&episodes, 0..position);
        append(&mut episodes, position..20);
        assert_holds(&episodes, 0..20);
        assert_eq!(files_in(tmp.path()), files_in(undisturbed.path()), "from {position}");
        assert_eq!(contents(tmp.path()), contents(undisturbed.path()), "from {position}");
    }
}

#[test]
fn a_record_written_in_part_by_a_killed_process_is_cut_off() {
    let tmp = tempfile::tempdir().unwrap();
    append(&mut open(tmp.path(), 0).unwrap(), 0..2);
    let path = tmp.path().join("replay/episodes-000000000000.bin");
    let whole = fs::read(&path).unwrap();
    fs::write(&path, [&whole, &header(2, &record(2))[..], b"half"].concat()).unwrap();
    assert_holds(&open(tmp.path(), 2).unwrap(), 0..2);
    assert_eq!(fs::read(&path).unwrap(), whole);
}

#[test]
fn what_nobody_needs_is_removed_by_whole_segments_only() {
    let tmp = tempfile::tempdir().unwrap();
    let mut episodes = open(tmp.path(), 0).unwrap();
    append(&mut episodes, 0..20);
    let all = files_in(tmp.path());
    let starts: Vec<u64> = all.iter().map(|name| first_record(name).unwrap()).collect();

    episodes.forget_before(starts[2] - 1).unwrap();
    assert_eq!(files_in(tmp.path()), all[1..]);
    episodes.forget_before(starts[2]).unwrap();
    assert_eq!(files_in(tmp.path()), all[2..]);
    assert_eq!(episodes.oldest(), starts[2]);
    assert_holds(&episodes, starts[2]..20);
    let error = episodes.read(starts[2] - 1, &mut vec![]).unwrap_err();
    let folder = tmp.path().join("replay");
    assert_eq!(
        error.to_string(),
        format!(
            "there is no record {} in `{}`, only those from {} up to 20, exclusive",
            starts[2] - 1,
            folder.display(),
            starts[2]
        )
    );
    assert!(episodes.read(20, &mut vec![]).is_err());

    // The last segment stays: new records go there.
    episodes.forget_before(1_000).unwrap();
    assert_eq!(files_in(tmp.path()).len(), 1);
    drop(episodes);
    let mut episodes = open(tmp.path(), 20).unwrap();
    append(&mut episodes, 20..22);
    assert_holds(&episodes, episodes.oldest()..22);
    episodes.require(episodes.oldest()).unwrap();
    assert_eq!(
        episodes.require(3).unwrap_err().to_string(),
        format!(
            "`{}` lacks episodes that the learner needs: the records from 3 to {} are \
             missing\nhint: files were changed or lost; copy them back, or start the run again in a new folder",
            folder.display(),
            episodes.oldest() - 1
        )
    );
}

#[test]
fn missing_and_damaged_records_are_refused_and_left_alone() {
    let tmp = tempfile::tempdir().unwrap();
    append(&mut open(tmp.path(), 0).unwrap(), 0..20);
    let names = files_in(tmp.path());
    let second = first_record(&names[1]).unwrap();
    let path = tmp.path().join("replay").join(&names[0]);
    let whole = fs::read(&path).unwrap();
    let refusal = |position| {
        let error = open(tmp.path(), position).unwrap_err();
        assert!(error.is_io(), "{error}");
        assert_eq!(files_in(tmp.path()).len(), names.len(), "nothing is removed");
        error.to_string()
    };
    let start = format!("`{}` lacks episodes that the learner needs: ", path.display());

    // One bit of record 1, which starts after the header of the empty record 0.
    let mut damaged = whole.clone();
    damaged[40] ^= 4;
    fs::write(&path, damaged).unwrap();
    for position in [2, 20] {
        let text = refusal(position);
        let expected = format!("{start}record 1, at byte 16, is not what was written there\nhint: ");
        assert!(text.starts_with(&expected), "{text}");
    }
    // A length that no file could have.
    let mut damaged = whole.clone();
    damaged[16..24].fill(0xff);
    fs::write(&path, damaged).unwrap();
    let ends = format!("{start}it ends before or within record 1, at byte {}\n", whole.len());
    assert!(refusal(20).starts_with(&ends), "{}", refusal(20));

    for cut in [1, 100] {
        fs::write(&path, &whole[..whole.len() - cut]).unwrap();
        let text = refusal(20);
        assert!(
            text.starts_with(&format!("{start}it ends before or within record {}", second - 1)),
            "{text}"
        );
    }
    fs::remove_file(&path).unwrap();
    let names = files_in(tmp.path());
    fs::rename(tmp.path().join("replay").join(&names[1]), tmp.path().join("x")).unwrap();
    let text = open(tmp.path(), 20).unwrap_err().to_string();
    let third = first_record(&names[1]).unwrap();
    assert!(text.contains(&format!("it ends before or within record {third}, at byte")), "{text}");

    fs::remove_dir_all(tmp.path().join("replay")).unwrap();
    let text = open(tmp.path(), 20).unwrap_err().to_string();
    assert!(text.contains("none of the 20 records exists"), "{text}");
}

#[test]
fn damage_that_comes_while_the_files_are_open_is_found_by_reading() {
    let tmp = tempfile::tempdir().unwrap();
    let mut episodes = open(tmp.path(), 0).unwrap();
    append(&mut episodes, 0..3);
    let path = tmp.path().join("replay/episodes-000000000000.bin");
    let mut bytes = fs::read(&path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&path, bytes).unwrap();
    assert_holds(&episodes, 0..2);
    let text = episodes.read(2, &mut vec![]).unwrap_err().to_string();
    assert!(text.contains("record 2, at byte 69, is not what was written there"), "{text}");
}

/// Set in the process that [`a_disk_that_is_full_half_way_through_a_record_loses_no_other`] starts.
const LIMITED: &str = "STORE_TEST_FILES_ARE_LIMITED";

#[test]
fn a_disk_that_is_full_half_way_through_a_record_loses_no_other() {
    if std::env::var_os(LIMITED).is_some() {
        return fill_the_disk();
    }
    // The system's limit on the size of a file simulates a full disk: a write succeeds up to the limit and then
    // fails. The limit applies to a whole process, hence a separate one.
    let test = "episodes::tests::a_disk_that_is_full_half_way_through_a_record_loses_no_other";
    let output = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\""])
        .arg(std::env::current_exe().unwrap())
        .args([test, "--exact", "--nocapture"])
        .env(LIMITED, "1")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("1 passed"), "{output:?}");
}

fn fill_the_disk() {
    let tmp = tempfile::tempdir().unwrap();
    let mut episodes = Episodes::open(tmp.path().to_owned(), 0).unwrap();
    let path = tmp.path().join("episodes-000000000000.bin");
    let size = || fs::metadata(&path).unwrap().len();
    // The limit is 4 or 8 KiB, as the shell counts.
    let error = loop {
        if let Err(error) = episodes.append(&[7; 900]) {
            break error;
        }
        assert_eq!(size(), episodes.position() * 916);
    };
    assert!(error.is_io());
    assert!(
        error.to_string().starts_with(&format!("could not append an episode to `{}`: ", path.display())),
        "{error}"
    );
    let held = episodes.position();
    assert!(held >= 4);
    assert_eq!(size(), held * 916, "no part of a record stays");
    let mut buffer = Vec::new();
    for number in 0..held {
        assert_eq!(episodes.read(number, &mut buffer).unwrap(), [7; 900]);
    }
    // A record that still fits is stored as if nothing had happened.
    episodes.append(b"small").unwrap();
    assert_eq!(episodes.read(held, &mut buffer).unwrap(), b"small");
    assert_eq!(episodes.sync().unwrap(), held + 1);
    let again = Episodes::open(tmp.path().to_owned(), held + 1).unwrap();
    assert_eq!(again.read(held, &mut buffer).unwrap(), b"small");
}
