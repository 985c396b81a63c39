//! Which version of a file is read.

use object_store::ObjectMeta;
use serde::{Deserialize, Serialize};

/// What a server says of a version of a file. A file is read at one version only: that of its first read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pin {
    e_tag: Option<String>,
    /// Milliseconds since 1970; 0 where an ETag tells versions apart, and where the server does not say.
    modified_ms: i64,
    /// Length of the file, bytes.
    pub len: u64,
}

impl Pin {
    pub fn of(meta: &ObjectMeta) -> Self {
        // Servers that share the work may differ in the time, not in the tag.
        let modified_ms = if meta.e_tag.is_some() { 0 } else { meta.last_modified.timestamp_millis() };
        Self { e_tag: meta.e_tag.clone(), modified_ms, len: meta.size }
    }

    /// For the header If-Match, by which the server itself refuses another version. It compares strongly: weak tags, which
    /// begin with `W/`, never match (RFC 9110, §13.1.1); such are compared here, in the answer.
    pub fn if_match(&self) -> Option<String> {
        self.e_tag.clone().filter(|e_tag| !e_tag.starts_with("W/"))
    }

    /// All of it as a text.
    pub fn text(&self) -> String {
        format!("{} {} {}", self.e_tag.as_deref().unwrap_or_default(), self.modified_ms, self.len)
    }
}
