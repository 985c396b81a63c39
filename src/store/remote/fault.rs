//! What went wrong on the way, in words that tell what to do.

use crate::store::StoreError;
use object_store::Error;
use object_store::client::{HttpError, HttpErrorKind};
use std::error::Error as _;
use std::path::Path;

/// What `object_store` writes before a status that is no success; its error type cannot be named.
const STATUS_TEXT: &str = "status code: ";

const TOO_MANY: u16 = 429;
const TIMED_OUT: u16 = 408;
const NO_SUCH_RANGE: u16 = 416;

/// `file`: with its address.
pub(super) fn sort(file: &Path, error: &Error) -> StoreError {
    let file = file.to_owned();
    match error {
        Error::NotFound { .. } => StoreError::Missing { file },
        Error::Precondition { .. } => StoreError::Changed { file },
        Error::NotSupported { .. } => StoreError::NoRanges { file },
        Error::PermissionDenied { .. } => StoreError::Denied { file, cause: "it answers 403".to_owned() },
        Error::Unauthenticated { .. } => StoreError::Denied { file, cause: "it answers 401".to_owned() },
        other => sort_status(file, other),
    }
}

fn sort_status(file: std::path::PathBuf, error: &Error) -> StoreError {
    match status(error) {
        Some(NO_SUCH_RANGE) => short(&file),
        Some(status @ (TOO_MANY | TIMED_OUT | 500..)) => {
            StoreError::Unanswered { file, cause: format!("the server answers {status}") }
        }
        Some(status) => StoreError::Answer { file, cause: format!("the server answers {status}") },
        None => match transport(error) {
            Some(cause) => StoreError::Unanswered { file, cause },
            None => StoreError::Answer { file, cause: root(error) },
        },
    }
}

/// The file ends before what is asked of it.
pub(super) fn short(file: &Path) -> StoreError {
    StoreError::Pack { file: file.to_owned(), cause: "it ends before a page that the index names".to_owned() }
}

fn status(error: &Error) -> Option<u16> {
    let text = error.to_string();
    let (_, after) = text.split_once(STATUS_TEXT)?;
    after.get(..3)?.parse().ok()
}

/// What broke the connection; `None` where it did not break.
fn transport(error: &Error) -> Option<String> {
    let mut cause = error.source();
    while let Some(next) = cause {
        if let Some(http) = next.downcast_ref::<HttpError>() {
            let why = innermost(http);
            return Some(match http.kind() {
                HttpErrorKind::Connect => format!("there is no connection to the server ({why})"),
                HttpErrorKind::Timeout => "the server does not answer in time".to_owned(),
                _ => format!("the connection broke ({why})"),
            });
        }
        cause = next.source();
    }
    None
}

fn root(error: &Error) -> String {
    format!("its answer makes no sense: {}", innermost(error))
}

fn innermost(error: &dyn std::error::Error) -> String {
    let mut innermost = error;
    while let Some(next) = innermost.source() {
        innermost = next;
    }
    innermost.to_string()
}
