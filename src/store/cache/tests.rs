use super::*;

fn name(kind: Kind, offset: u64, len: usize) -> EntryName {
    EntryName { kind, file: 7, offset, len: len as u32 }
}

fn bytes(seed: u64, len: usize) -> Vec<u8> {
    (0..len as u64).map(|at| (at.wrapping_mul(31) ^ seed.wrapping_mul(0x9E37_79B9)) as u8).collect()
}

fn keep(cache: &DiskCache, offset: u64, len: usize) {
    cache.keep(&name(Kind::Pages, offset, len), &bytes(offset, len));
}

fn has(cache: &DiskCache, offset: u64, len: usize) -> bool {
    let found = cache.find(7, offset, len as u32).and_then(|name| Some((name, cache.load(&name)?)));
    found.is_some_and(|(name, kept)| {
        assert_eq!(kept, bytes(name.offset, name.len as usize));
        true
    })
}

/// What all files in a folder take on the disk.
fn on_disk(folder: &Path) -> u64 {
    let files = fs::read_dir(folder).unwrap().map(|file| file.unwrap().metadata().unwrap().len());
    files.map(entry::disk_bytes).sum()
}

#[test]
fn the_limit_holds_and_what_was_used_last_stays() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(folder.path(), CACHE_LIMIT_MIN).unwrap();
    // 16 files of 64 KiB would take a block more than the limit.
    let len = 64 << 10;
    for at in 0..40u64 {
        keep(&cache, at << 20, len);
        assert!(has(&cache, 0, len), "{at}: it is used all the time");
        assert!(has(&cache, at << 20, len));
        assert!(on_disk(folder.path()) <= CACHE_LIMIT_MIN.0);
    }
    assert!(!has(&cache, 1 << 20, len) && has(&cache, 38 << 20, len));
    assert!(on_disk(folder.path()) > CACHE_LIMIT_MIN.0 / 2, "it is made use of");
    // Longer than all of it: not kept, and nothing goes for it.
    let before = on_disk(folder.path());
    keep(&cache, 99 << 20, 2 << 20);
    assert!(!has(&cache, 99 << 20, 2 << 20));
    assert!(on_disk(folder.path()) <= before);
}

#[test]
fn ranges_are_found_inside_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(folder.path(), CACHE_LIMIT).unwrap();
    keep(&cache, 1000, 500);
    keep(&cache, 1200, 800);
    for (offset, len, is_there) in
        [(1000, 500, true), (1100, 10, true), (1300, 700, true), (999, 10, false), (1100, 600, false), (2000, 1, false)]
    {
        assert_eq!(has(&cache, offset, len), is_there, "{offset} {len}");
    }
    let other = cache.find(8, 1000, 500);
    assert_eq!(other, None, "another file");
}

#[test]
fn what_is_left_over_or_broken_is_removed_and_others_files_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let limit = ByteSize(4 << 20);
    let cache = DiskCache::open(folder.path(), limit).unwrap();
    (0..4).for_each(|at| keep(&cache, at << 20, 10_000));
    let path = |at: u64| folder.path().join(name(Kind::Pages, at << 20, 10_000).to_string());
    // A flipped byte, a short file, another entry's file, an empty one; a write that was broken off; somebody's notes.
    let mut flipped = fs::read(path(0)).unwrap();
    flipped[5000] ^= 1;
    fs::write(path(0), flipped).unwrap();
    fs::write(path(1), &fs::read(path(1)).unwrap()[..900]).unwrap();
    fs::copy(path(3), path(2)).unwrap();
    let left = folder.path().join(format!("{}{PARTIAL}", name(Kind::Pages, 77, 5)));
    fs::write(&left, "half of it").unwrap();
    fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    drop(cache);
    let cache = DiskCache::open(folder.path(), limit).unwrap();
    assert!(!left.exists() && folder.path().join("notes.txt").exists());
    for at in 0..3 {
        assert!(!has(&cache, at << 20, 10_000) && !path(at).exists(), "{at}");
        keep(&cache, at << 20, 10_000);
        assert!(has(&cache, at << 20, 10_000), "it is kept anew");
    }
    assert!(has(&cache, 3 << 20, 10_000));
    let mut ledger = Ledger::lock(folder.path()).unwrap().unwrap();
    assert_eq!(ledger.total_bytes(), Some(on_disk(folder.path()) - entry::BLOCK_BYTES), "all but the notes");
}

#[test]
fn a_lower_limit_holds_after_a_restart_and_the_oldest_go() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(folder.path(), ByteSize(8 << 20)).unwrap();
    for at in 0..40u64 {
        keep(&cache, at << 20, 100_000);
        let path = folder.path().join(name(Kind::Pages, at << 20, 100_000).to_string());
        let used = SystemTime::UNIX_EPOCH + Duration::from_secs(1000 + at);
        File::options().append(true).open(path).unwrap().set_modified(used).unwrap();
    }
    drop(cache);
    let cache = DiskCache::open(folder.path(), CACHE_LIMIT_MIN).unwrap();
    assert!(on_disk(folder.path()) <= CACHE_LIMIT_MIN.0);
    assert!(has(&cache, 39 << 20, 100_000) && has(&cache, 32 << 20, 100_000) && !has(&cache, 20 << 20, 100_000));
}

#[test]
fn what_worlds_are_opened_with_goes_last_and_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(folder.path(), CACHE_LIMIT_MIN).unwrap();
    let manifest = EntryName::whole(Kind::Manifest, 1);
    cache.keep(&manifest, b"old");
    cache.keep(&manifest, b"new");
    assert_eq!(cache.load(&manifest).as_deref(), Some(&b"new"[..]));
    (0..40).for_each(|at| keep(&cache, at << 20, 64 << 10));
    assert_eq!(cache.load(&manifest).as_deref(), Some(&b"new"[..]));
    // Not all of the cache is for it.
    for at in 0..40u64 {
        cache.keep(&name(Kind::Index, at << 20, 64 << 10), &bytes(at << 20, 64 << 10));
        keep(&cache, at << 20 | 1 << 19, 32 << 10);
        assert!(has(&cache, at << 20 | 1 << 19, 32 << 10));
        assert!(on_disk(folder.path()) <= CACHE_LIMIT_MIN.0);
    }
    cache.forget(&manifest);
    assert_eq!(cache.load(&manifest), None);
}

#[test]
fn several_at_once_keep_one_limit_and_whole_entries() {
    let folder = tempfile::tempdir().unwrap();
    let caches: Vec<DiskCache> = (0..3).map(|_| DiskCache::open(folder.path(), ByteSize(2 << 20)).unwrap()).collect();
    std::thread::scope(|scope| {
        for (number, cache) in caches.iter().enumerate() {
            scope.spawn(move || {
                for at in 0..60u64 {
                    // Some are the same for all.
                    let offset = if at % 3 == 0 { at << 20 } else { (at << 20) + (number as u64) * 200_000 };
                    keep(cache, offset, 50_000 + number * 1000 * usize::from(at % 3 != 0));
                    has(cache, offset, 50_000);
                }
            });
        }
        for _ in 0..50 {
            // Nobody writes meanwhile.
            let Some(held) = Ledger::lock(folder.path()).unwrap() else { continue };
            assert!(on_disk(folder.path()) <= 2 << 20);
            drop(held);
            std::thread::yield_now();
        }
    });
    assert!(on_disk(folder.path()) <= 2 << 20);
    let again = DiskCache::open(folder.path(), ByteSize(2 << 20)).unwrap();
    assert!(again.lock().bytes() > 1 << 20, "it is made use of");
}

#[test]
fn a_folder_that_another_process_holds_is_read_and_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(folder.path(), CACHE_LIMIT).unwrap();
    keep(&cache, 0, 100);
    let held = Ledger::lock(folder.path()).unwrap().unwrap();
    keep(&cache, 5000, 100);
    assert!(has(&cache, 0, 100) && !has(&cache, 5000, 100));
    let other = DiskCache::open(folder.path(), CACHE_LIMIT).unwrap();
    assert!(has(&other, 0, 100));
    drop(held);
}

#[test]
fn what_cannot_be_a_cache_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let error = DiskCache::open(folder.path(), ByteSize(1000)).err().unwrap().to_string();
    assert!(error.contains("too low"), "{error}");
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = DiskCache::open(&file, CACHE_LIMIT).err().unwrap().to_string();
    assert!(error.contains("cannot be used") && error.contains("--cache"), "{error}");
}
