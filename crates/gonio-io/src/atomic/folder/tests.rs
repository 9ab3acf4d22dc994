use super::*;

/// Returns all paths below `dir`, relative and sorted.
fn tree(dir: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut open = vec![dir.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            found.push(path.strip_prefix(dir).unwrap().to_string_lossy().into_owned());
            if path.is_dir() {
                open.push(path);
            }
        }
    }
    found.sort();
    found
}

#[test]
fn a_new_folder_appears_as_a_whole() {
    let dir = tempfile::tempdir().unwrap();
    let staged = StagedFolder::create(dir.path().join("a/b/out")).unwrap();
    fs::write(staged.path("x"), "x").unwrap();
    fs::write(staged.path("y"), "y").unwrap();
    assert!(!dir.path().join("a/b/out").exists());
    staged.commit().unwrap();
    assert_eq!(tree(dir.path()), ["a", "a/b", "a/b/out", "a/b/out/x", "a/b/out/y"]);
}

#[test]
fn dropping_leaves_no_trace() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("old")).unwrap();
    for target in ["a/b/out", "new", "old"] {
        let staged = StagedFolder::create(dir.path().join(target)).unwrap();
        fs::write(staged.path("x"), "x").unwrap();
        drop(staged);
        assert_eq!(tree(dir.path()), ["old"], "{target}");
    }
}

#[test]
fn files_of_an_existing_folder_are_replaced_one_by_one() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("x"), "old").unwrap();
    fs::write(out.join("other"), "kept").unwrap();
    let staged = StagedFolder::create(&out).unwrap();
    fs::write(staged.path("x"), "new").unwrap();
    assert_eq!(fs::read_to_string(out.join("x")).unwrap(), "old");
    staged.commit().unwrap();
    assert_eq!(fs::read_to_string(out.join("x")).unwrap(), "new");
    assert_eq!(tree(&out), ["other", "x"]);
}

#[test]
fn removes_discarded_files_on_commit() {
    let dir = tempfile::tempdir().unwrap();
    for folder in ["out/a", "out/b", "out/gone"] {
        fs::create_dir_all(dir.path().join(folder)).unwrap();
    }
    for file in ["keep", "out/x", "out/old", "out/other", "out/a/old", "out/b/old", "out/b/other"] {
        fs::write(dir.path().join(file), "old").unwrap();
    }
    let out = dir.path().join("out");
    let names = ["x", "old", "a", "a/old", "b", "b/old", "missing", "gone/old", "gone", "../keep"];
    let mut staged = StagedFolder::create(&out).unwrap();
    staged.discard(names.map(PathBuf::from));
    drop(staged);
    assert_eq!(tree(&out).len(), 9, "dropped before the commit: {:?}", tree(&out));
    let mut staged = StagedFolder::create(&out).unwrap();
    staged.discard(names.map(PathBuf::from));
    fs::write(staged.path("x"), "new").unwrap();
    staged.commit().unwrap();
    assert_eq!(tree(dir.path()), ["keep", "out", "out/b", "out/b/other", "out/other", "out/x"]);
    assert_eq!(fs::read_to_string(out.join("x")).unwrap(), "new");
}

#[cfg(unix)]
#[test]
fn removes_leftovers_of_killed_processes_but_no_locked_folders() {
    let dir = tempfile::tempdir().unwrap();
    let left = dir.path().join(".gonio-abcdef.unfinished");
    fs::create_dir(&left).unwrap();
    fs::write(left.join("x"), "half").unwrap();
    fs::create_dir(dir.path().join(".gonio-mine")).unwrap();
    fs::write(dir.path().join(".gonio-file.unfinished"), "a file").unwrap();
    let first = StagedFolder::create(dir.path().join("a")).unwrap();
    fs::write(first.path("x"), "x").unwrap();
    let second = StagedFolder::create(dir.path().join("b")).unwrap();
    assert!(!left.exists());
    second.commit().unwrap();
    fs::create_dir(&left).unwrap();
    drop(StagedFolder::create(dir.path().join("b")).unwrap());
    assert!(!left.exists(), "left beside a folder that exists now");
    first.commit().unwrap();
    assert_eq!(tree(dir.path()), [".gonio-file.unfinished", ".gonio-mine", "a", "a/x", "b"]);
}

#[test]
fn replaces_nothing_if_a_folder_is_in_the_way() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("y")).unwrap();
    fs::write(dir.path().join("x"), "old").unwrap();
    let staged = StagedFolder::create(dir.path()).unwrap();
    fs::write(staged.path("x"), "new").unwrap();
    fs::write(staged.path("y"), "new").unwrap();
    assert_eq!(staged.commit().unwrap_err().io_kind(), Some(io::ErrorKind::IsADirectory));
    assert_eq!(fs::read_to_string(dir.path().join("x")).unwrap(), "old");
    assert_eq!(tree(dir.path()), ["x", "y"]);
}

#[test]
fn fills_a_folder_created_before_the_commit() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let staged = StagedFolder::create(&out).unwrap();
    fs::write(staged.path("x"), "new").unwrap();
    fs::create_dir(&out).unwrap();
    fs::write(out.join("other"), "").unwrap();
    staged.commit().unwrap();
    assert_eq!(tree(dir.path()), ["out", "out/other", "out/x"]);
}

#[test]
fn reports_files_in_place_of_folders() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("f"), "").unwrap();
    let error = StagedFolder::create(dir.path().join("f")).unwrap_err();
    assert!(error.to_string().contains("a file with this name exists"), "{error}");
    for below in ["f/out", "f/a/out"] {
        let error = StagedFolder::create(dir.path().join(below)).unwrap_err();
        assert_eq!(error.io_kind(), Some(io::ErrorKind::NotADirectory), "{error}");
    }
    assert_eq!(tree(dir.path()), ["f"]);
}

#[cfg(unix)]
#[test]
fn the_new_folder_has_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let dir = tempfile::tempdir().unwrap();
    StagedFolder::create(dir.path().join("a")).unwrap().commit().unwrap();
    fs::create_dir(dir.path().join("b")).unwrap();
    let mode = |name: &str| fs::metadata(dir.path().join(name)).unwrap().permissions().mode();
    assert_eq!(mode("a"), mode("b"));
}
