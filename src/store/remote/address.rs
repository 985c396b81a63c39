//! Addresses of worlds: `http://`, `https://`, `s3://`.

use crate::store::{MANIFEST_FILE, StoreError};
use std::path::{Path, PathBuf};
use url::Url;

/// Where a world lies on a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    url: Url,
    /// For messages.
    shown: String,
}

/// What may come before `://`.
pub const SCHEMES: [&str; 3] = ["http", "https", "s3"];

impl Address {
    /// `None` for what is no address but a folder.
    pub fn of(world: &Path) -> Option<Result<Self, StoreError>> {
        let text = world.to_str().filter(|text| text.contains("://"))?;
        Some(Self::parse(text))
    }

    fn parse(text: &str) -> Result<Self, StoreError> {
        let no_address =
            |error| StoreError::Address { address: text.into(), cause: format!("it is no address: {error}") };
        let mut url = Url::parse(text.trim()).map_err(no_address)?;
        let shown = without_user(&url);
        let refused = |cause: String| StoreError::Address { address: shown.clone().into(), cause };
        if !url.username().is_empty() || url.password().is_some() {
            return Err(refused("names and passwords of users are not sent to servers".to_owned()));
        }
        if !SCHEMES.contains(&url.scheme()) {
            return Err(refused(format!("worlds are not read over {}", url.scheme())));
        }
        if url.host_str().is_none_or(str::is_empty) {
            return Err(refused("it names no host".to_owned()));
        }
        if url.query().is_some() || url.fragment().is_some() {
            return Err(refused("it goes on behind the folder: a world has several files".to_owned()));
        }
        let folder = url.path().strip_suffix(MANIFEST_FILE).unwrap_or(url.path()).trim_end_matches('/').to_owned();
        url.set_path(&folder);
        let shown = url.as_str().trim_end_matches('/').to_owned();
        Ok(Self { shown, url })
    }

    pub fn is_s3(&self) -> bool {
        self.url.scheme() == "s3"
    }

    pub fn url(&self) -> &Url {
        &self.url
    }

    /// For messages.
    pub fn shown(&self) -> &str {
        &self.shown
    }

    /// The name of a file for messages; `name` as in `packs/07.pack`.
    pub fn file(&self, name: &str) -> PathBuf {
        format!("{}/{name}", self.shown).into()
    }
}

/// A password is nothing to print.
fn without_user(url: &Url) -> String {
    let mut url = url.clone();
    // Addresses without a host have neither.
    let _ = (url.set_username(""), url.set_password(None));
    url.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Option<Result<Address, String>> {
        Some(Address::of(Path::new(text))?.map_err(|error| error.to_string()))
    }

    #[test]
    fn folders_are_told_from_addresses() {
        for folder in ["world", "/tmp/w", "C:\\worlds\\w", "http", "./s3:/x", ""] {
            assert!(of(folder).is_none(), "{folder}");
        }
        for (text, shown) in [
            ("http://host:8000/w", "http://host:8000/w"),
            ("https://host/a/b/", "https://host/a/b"),
            ("https://host/a/world.json", "https://host/a"),
            ("HTTP://Host/", "http://host"),
            ("s3://bucket/far/away", "s3://bucket/far/away"),
        ] {
            let address = of(text).unwrap().unwrap();
            assert_eq!(address.shown(), shown);
            assert_eq!(address.file("packs/07.pack"), PathBuf::from(format!("{shown}/packs/07.pack")));
        }
    }

    #[test]
    fn what_cannot_be_read_is_said() {
        for (text, said) in [
            ("ftp://host/w", "not read over ftp"),
            ("gs://bucket/w", "not read over gs"),
            ("http://", "no address"),
            ("s3:///w", "names no host"),
            ("http://me:secret@host/w", "names and passwords"),
            ("http://host/w?token=1", "goes on behind"),
            ("http://host/w#part", "goes on behind"),
        ] {
            let error = of(text).unwrap().unwrap_err();
            assert!(error.contains(said) && error.contains("http://HOST"), "{text}: {error}");
            assert!(!error.contains("secret"));
        }
    }
}
