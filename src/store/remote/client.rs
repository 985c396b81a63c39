//! Requests to one server, with retries, and with an end.

use super::address::Address;
use super::fault;
use super::pin::Pin;
use crate::store::StoreError;
use object_store::aws::AmazonS3Builder;
use object_store::http::HttpBuilder;
use object_store::path::Path as ObjectPath;
use object_store::{BackoffConfig, ClientOptions, GetOptions, GetRange, HeaderValue, ObjectStore, RetryConfig};
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

/// Threads that transfer for one world, and most threads that look up names for it.
const THREADS: usize = 2;
const LOOK_UP_THREADS_MAX: usize = 2;
/// A connection must be there, and an answer be complete, within these; they are tried again until the retries are
/// used up or [`RETRY_UNTIL`] has gone by.
const CONNECT_LIMIT: Duration = Duration::from_secs(5);
const ATTEMPT_LIMIT: Duration = Duration::from_secs(15);
/// A server that sends nothing for so long is taken for gone.
const SILENCE_LIMIT: Duration = Duration::from_secs(8);
const RETRIES_MAX: usize = 3;
const RETRY_UNTIL: Duration = Duration::from_secs(10);
const BACKOFF_FIRST: Duration = Duration::from_millis(100);
const BACKOFF_MAX: Duration = Duration::from_secs(2);
/// No request takes longer, all of its retries included.
pub const REQUEST_LIMIT: Duration = Duration::from_secs(30);
/// Requests at once where many are needed before anything can go on.
const AT_ONCE: usize = 8;
/// Longest file that is read whole, bytes: no manifest comes near.
const WHOLE_BYTES_MAX: u64 = 64 << 20;

const USER_AGENT: &str = concat!("stoop/", env!("CARGO_PKG_VERSION"));

/// Variables by which S3 is told who asks. Without any of them requests are not signed: public buckets need none.
const S3_CREDENTIALS: [&str; 5] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_METADATA_ENDPOINT",
];
/// Variables that name another server than Amazon's.
const S3_ENDPOINTS: [&str; 3] = ["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT"];

/// What is asked of a file.
#[derive(Clone, Debug)]
pub(super) struct Request {
    /// As in `packs/07.pack`.
    pub name: String,
    /// All of the file where there is none; cut where the file ends.
    pub range: Option<Range<u64>>,
    /// The version that it must have.
    pub pin: Option<Pin>,
}

/// What came.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    pub bytes: Vec<u8>,
    pub pin: Pin,
}

/// A server, and the threads that talk to it.
pub(super) struct Client {
    address: Address,
    store: Arc<dyn ObjectStore>,
    folder: ObjectPath,
    /// Only taken when dropped.
    runtime: Option<Runtime>,
}

impl Client {
    pub fn new(address: Address) -> Result<Self, StoreError> {
        let refused = |cause: String| StoreError::Address {
            address: address.shown().into(),
            cause: format!("it cannot be used: {cause}"),
        };
        let (store, folder) = store(&address).map_err(|error| refused(error.to_string()))?;
        let runtime = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .max_blocking_threads(LOOK_UP_THREADS_MAX)
            .thread_name("transfer")
            .enable_all()
            .build()
            .map_err(|error| refused(format!("threads cannot be started: {error}")))?;
        Ok(Self { address, store, folder, runtime: Some(runtime) })
    }

    pub fn address(&self) -> &Address {
        &self.address
    }

    /// The address that tells a world from all others: buckets of different servers may have the same name.
    pub fn full_address(&self) -> String {
        let endpoint = s3_endpoint().filter(|_| self.address.is_s3());
        endpoint.map_or_else(String::new, |endpoint| format!("{endpoint} ")) + self.address.shown()
    }

    /// One request, again where it failed in a way that may pass; no longer than [`REQUEST_LIMIT`].
    pub fn get(&self, request: Request) -> Result<Answer, StoreError> {
        let Some(runtime) = &self.runtime else { return Err(self.stopped(&request)) };
        runtime.block_on(self.exchange(request))
    }

    /// Several requests, some of them at once; answers in the order of the requests.
    pub fn get_all(&self, requests: Vec<Request>) -> Vec<Result<Answer, StoreError>> {
        let Some(runtime) = &self.runtime else {
            return requests.iter().map(|request| Err(self.stopped(request))).collect();
        };
        let mut answers = Vec::with_capacity(requests.len());
        for group in requests.chunks(AT_ONCE) {
            let tasks: Vec<_> =
                group.iter().map(|request| (request, runtime.spawn(self.exchange(request.clone())))).collect();
            for (request, task) in tasks {
                answers.push(runtime.block_on(task).unwrap_or_else(|_| Err(self.stopped(request))));
            }
        }
        answers
    }

    fn stopped(&self, request: &Request) -> StoreError {
        let file = self.address.file(&request.name);
        StoreError::Unanswered { file, cause: "the transfer was broken off".to_owned() }
    }

    /// Holds nothing of the client, so that it can go on by itself.
    fn exchange(&self, request: Request) -> impl Future<Output = Result<Answer, StoreError>> + Send + 'static {
        let (store, file) = (self.store.clone(), self.address.file(&request.name));
        let at = self.folder.parts().chain(ObjectPath::from(request.name).parts()).collect();
        let options = GetOptions {
            if_match: request.pin.as_ref().and_then(Pin::if_match),
            range: request.range.map(GetRange::Bounded),
            ..GetOptions::default()
        };
        async move {
            let exchanged = tokio::time::timeout(REQUEST_LIMIT, transfer(&*store, &at, options)).await;
            let late = |_| StoreError::Unanswered {
                file: file.clone(),
                cause: format!("the server does not answer within {} s", REQUEST_LIMIT.as_secs()),
            };
            let answer = exchanged.map_err(late)?.map_err(|failure| failure.told(&file))?;
            match request.pin {
                Some(pin) if pin != answer.pin => Err(StoreError::Changed { file }),
                _ => Ok(answer),
            }
        }
    }
}

enum Failure {
    Store(object_store::Error),
    /// Bytes that came, and that the server had announced.
    Short(usize, u64),
    TooLong(u64),
}

impl Failure {
    fn told(&self, file: &std::path::Path) -> StoreError {
        let file = file.to_owned();
        match self {
            Self::Store(error) => fault::sort(&file, error),
            Self::Short(came, told) => {
                StoreError::Unanswered { file, cause: format!("only {came} of {told} bytes came") }
            }
            Self::TooLong(len) => StoreError::Answer { file, cause: format!("{len} bytes are too many for this file") },
        }
    }
}

async fn transfer(store: &dyn ObjectStore, at: &ObjectPath, options: GetOptions) -> Result<Answer, Failure> {
    let is_whole = options.range.is_none();
    let result = store.get_opts(at, options).await.map_err(Failure::Store)?;
    let (pin, told) = (Pin::of(&result.meta), result.range.end - result.range.start);
    if is_whole && told > WHOLE_BYTES_MAX {
        return Err(Failure::TooLong(told));
    }
    let bytes = result.bytes().await.map_err(Failure::Store)?;
    if bytes.len() as u64 != told {
        return Err(Failure::Short(bytes.len(), told));
    }
    Ok(Answer { bytes: bytes.into(), pin })
}

impl Drop for Client {
    /// Does not wait for what hangs.
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn store(address: &Address) -> object_store::Result<(Arc<dyn ObjectStore>, ObjectPath)> {
    let retries = RetryConfig {
        backoff: BackoffConfig { init_backoff: BACKOFF_FIRST, max_backoff: BACKOFF_MAX, base: 2.0 },
        max_retries: RETRIES_MAX,
        retry_timeout: RETRY_UNTIL,
    };
    let options = ClientOptions::new()
        .with_connect_timeout(CONNECT_LIMIT)
        .with_timeout(ATTEMPT_LIMIT)
        .with_read_timeout(SILENCE_LIMIT)
        .with_user_agent(HeaderValue::from_static(USER_AGENT));
    if address.is_s3() {
        return s3(address, retries, options);
    }
    let options = options.with_allow_http(true);
    let http = HttpBuilder::new().with_url(address.url().as_str().trim_end_matches('/'));
    Ok((Arc::new(http.with_client_options(options).with_retry(retries).build()?), ObjectPath::default()))
}

fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.is_empty())
}

/// The server that buckets are asked of, where it is not Amazon's.
fn s3_endpoint() -> Option<String> {
    S3_ENDPOINTS.iter().find_map(|name| variable(name))
}

fn s3(
    address: &Address,
    retries: RetryConfig,
    options: ClientOptions,
) -> object_store::Result<(Arc<dyn ObjectStore>, ObjectPath)> {
    let is_anonymous = !S3_CREDENTIALS.iter().any(|name| variable(name).is_some());
    // A server that is named without TLS is meant to be asked without.
    let is_plain = s3_endpoint().is_some_and(|endpoint| endpoint.starts_with("http://"));
    let mut builder = AmazonS3Builder::from_env()
        .with_bucket_name(address.url().host_str().unwrap_or_default())
        .with_client_options(options.with_allow_http(is_plain))
        .with_retry(retries);
    if is_anonymous {
        builder = builder.with_skip_signature(true);
    }
    Ok((Arc::new(builder.build()?), ObjectPath::from_url_path(address.url().path())?))
}
