//! A small web server over a folder, for tests: answers GET with ranges, ETag and If-Match, counts what it is asked for,
//! and goes wrong as it is told.
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]
#![allow(dead_code, reason = "each test program uses its own part")]

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::Builder;
use std::time::Duration;

/// How requests are answered.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Manners {
    #[default]
    Good,
    /// With a status and a page of text.
    Status(u16),
    /// The connection is closed after half of the body.
    BreaksOff,
    /// Fewer bytes than announced by Content-Range, with a Content-Length that says so.
    Short,
    /// Whole files, whatever range is asked for.
    IgnoresRange,
    /// Neither ETag nor If-Match; Last-Modified alone.
    NoETag,
    /// ETags that begin with `W/`.
    WeakETag,
    /// ETags are sent, and If-Match is not looked at.
    IgnoresIfMatch,
    /// Connections are closed without an answer.
    Dead,
}

/// A request that was answered or refused.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Without the first `/`.
    pub path: String,
    pub range: Option<Range<u64>>,
}

#[derive(Default)]
struct State {
    manners: Manners,
    /// Requests that are treated so; further ones as [`Manners::Good`].
    for_requests: Option<usize>,
    delay: Duration,
    asked: Vec<Asked>,
    /// By path: changes that are told of files whose bytes stay.
    versions: HashMap<String, u64>,
    /// After so many more requests another folder takes the place of the one that is served.
    moves: Option<(usize, PathBuf)>,
    folder: PathBuf,
}

pub struct Web {
    at: SocketAddr,
    state: Arc<Mutex<State>>,
}

impl Web {
    /// Serves until the program ends.
    pub fn serve(folder: &Path) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let state = Arc::new(Mutex::new(State { folder: folder.to_owned(), ..State::default() }));
        let web = Self { at: listener.local_addr().unwrap(), state: state.clone() };
        let serve = move || {
            for stream in listener.incoming().flatten() {
                let state = state.clone();
                Builder::new().name("connection".into()).spawn(move || converse(stream, &state)).unwrap();
            }
        };
        Builder::new().name("web".into()).spawn(serve).unwrap();
        web
    }

    /// The address of a folder in the folder.
    pub fn url(&self, folder: &str) -> PathBuf {
        format!("http://{}/{folder}", self.at).into()
    }

    pub fn address(&self) -> String {
        format!("http://{}", self.at)
    }

    pub fn behave(&self, manners: Manners) {
        let mut state = self.state.lock().unwrap();
        (state.manners, state.for_requests) = (manners, None);
    }

    /// For so many requests only.
    pub fn behave_for(&self, requests: usize, manners: Manners) {
        let mut state = self.state.lock().unwrap();
        (state.manners, state.for_requests) = (manners, Some(requests));
    }

    pub fn delay(&self, delay: Duration) {
        self.state.lock().unwrap().delay = delay;
    }

    /// A file has another version from now on.
    pub fn change(&self, path: &str) {
        *self.state.lock().unwrap().versions.entry(path.to_owned()).or_default() += 1;
    }

    /// Another folder is served after so many more requests.
    pub fn move_after(&self, requests: usize, folder: &Path) {
        self.state.lock().unwrap().moves = Some((requests, folder.to_owned()));
    }

    /// Requests since the last call.
    pub fn take_asked(&self) -> Vec<Asked> {
        std::mem::take(&mut self.state.lock().unwrap().asked)
    }
}

struct Request {
    is_head: bool,
    path: String,
    range: Option<Range<u64>>,
    if_match: Option<String>,
}

/// Answers requests of one connection until it is closed.
fn converse(stream: TcpStream, state: &Mutex<State>) -> Option<()> {
    let mut reader = BufReader::new(stream.try_clone().ok()?);
    let mut stream = stream;
    loop {
        let request = read_request(&mut reader)?;
        let (manners, delay, version, folder) = {
            let mut state = state.lock().unwrap();
            state.asked.push(Asked { path: request.path.clone(), range: request.range.clone() });
            let manners = match &mut state.for_requests {
                Some(0) => Manners::Good,
                Some(left) => {
                    *left -= 1;
                    state.manners
                }
                None => state.manners,
            };
            match &mut state.moves {
                Some((0, folder)) => state.folder = std::mem::take(folder),
                Some((left, _)) => *left -= 1,
                None => {}
            }
            state.moves.take_if(|moves| moves.1 == PathBuf::new());
            let version = state.versions.get(&request.path).copied().unwrap_or(0);
            (manners, state.delay, version, state.folder.clone())
        };
        if !delay.is_zero() {
            let _ = crossbeam_channel::after(delay).recv();
        }
        if !answer(&mut stream, &folder, &request, manners, version)? {
            return None;
        }
    }
}

fn read_request(reader: &mut impl BufRead) -> Option<Request> {
    let mut line = String::new();
    reader.read_line(&mut line).ok().filter(|&len| len > 0)?;
    let mut words = line.split_whitespace();
    let (method, path) = (words.next()?.to_owned(), words.next()?.trim_start_matches('/').to_owned());
    let (mut range, mut if_match) = (None, None);
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok().filter(|&len| len > 0)?;
        let Some((name, value)) = line.trim_end().split_once(": ") else { break };
        match name.to_ascii_lowercase().as_str() {
            "range" => {
                let (from, to) = value.strip_prefix("bytes=")?.split_once('-')?;
                range = Some(from.parse().ok()?..to.parse::<u64>().ok()? + 1);
            }
            "if-match" => if_match = Some(value.to_owned()),
            _ => {}
        }
    }
    Some(Request { is_head: method == "HEAD", path, range, if_match })
}

/// Whether the connection stays.
fn answer(stream: &mut TcpStream, folder: &Path, request: &Request, manners: Manners, version: u64) -> Option<bool> {
    if manners == Manners::Dead {
        return Some(false);
    }
    if let Manners::Status(status) = manners {
        return plain(stream, status);
    }
    let Ok(file) = fs::read(folder.join(&request.path)) else { return plain(stream, 404) };
    let (len, hash) = (file.len() as u64, xxhash_rust::xxh3::xxh3_64(&file));
    let e_tag = match manners {
        Manners::NoETag => None,
        Manners::WeakETag => Some(format!("W/\"{hash:x}-{version}\"")),
        _ => Some(format!("\"{hash:x}-{version}\"")),
    };
    let is_looked_at = !matches!(manners, Manners::NoETag | Manners::IgnoresIfMatch);
    // Weak ones never match.
    let matches = |wanted: &String| e_tag.as_ref() == Some(wanted) && !wanted.starts_with("W/");
    if is_looked_at && request.if_match.as_ref().is_some_and(|wanted| !matches(wanted)) {
        return plain(stream, 412);
    }
    let range = request.range.clone().filter(|_| manners != Manners::IgnoresRange);
    let sent = range.clone().unwrap_or(0..len);
    if sent.start >= len && range.is_some() {
        return plain(stream, 416);
    }
    let sent = sent.start..sent.end.min(len);
    let mut bytes = file[sent.start as usize..sent.end as usize].to_vec();
    if manners == Manners::Short {
        bytes.truncate(bytes.len() / 2);
    }
    let mut head = if range.is_some() { "HTTP/1.1 206 Partial Content\r\n" } else { "HTTP/1.1 200 OK\r\n" }.to_owned();
    head += &format!("Content-Length: {}\r\n", bytes.len());
    head += &format!("Last-Modified: Mon, 02 Jan 2023 10:00:{:02} GMT\r\n", version % 60);
    if let Some(e_tag) = e_tag {
        head += &format!("ETag: {e_tag}\r\n");
    }
    if range.is_some() {
        head += &format!("Content-Range: bytes {}-{}/{len}\r\n", sent.start, sent.end - 1);
    }
    stream.write_all((head + "\r\n").as_bytes()).ok()?;
    if request.is_head {
        return Some(true);
    }
    if manners == Manners::BreaksOff {
        stream.write_all(&bytes[..bytes.len() / 2]).ok()?;
        return Some(false);
    }
    stream.write_all(&bytes).ok()?;
    Some(true)
}

fn plain(stream: &mut TcpStream, status: u16) -> Option<bool> {
    let body = "<html>something went wrong; status code: 999</html>";
    let head = format!("HTTP/1.1 {status} So\r\nContent-Type: text/html\r\nContent-Length: {}\r\n\r\n", body.len());
    stream.write_all((head + body).as_bytes()).ok()?;
    Some(true)
}
