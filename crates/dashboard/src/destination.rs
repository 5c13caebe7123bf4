//! Where does a recording go?

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use rerun::sink::{FileSink, FileSinkOptions};
use rerun::{RecordingStream, RecordingStreamBuilder};

/// The name under which viewers keep the layout.
pub(crate) const APPLICATION: &str = "chronotope";
/// How long a viewer may take to take over what was logged last.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(30);
/// How long a viewer may take to answer at all.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// Where a recording goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// A file to be opened later; replaced if it exists.
    File(PathBuf),
    /// A viewer that is running, `rerun+http://HOST:PORT/proxy`.
    Viewer(String),
}

impl Destination {
    /// Starts a recording; fails if the file cannot be written or no viewer listens.
    pub(crate) fn open(&self) -> Result<RecordingStream> {
        let builder = RecordingStreamBuilder::new(APPLICATION);
        match self {
            Self::File(path) => {
                // A footer lists every chunk of the file and is kept in memory until the end: it
                // would grow with the session. Viewers read files without one from the beginning.
                let options = FileSinkOptions {
                    write_footer: false,
                };
                let file = FileSink::with_options(path, options)
                    .with_context(|| format!("cannot write {}", path.display()))?;
                let stream = builder.buffered()?;
                stream.set_sink(Box::new(file));
                Ok(stream)
            }
            Self::Viewer(url) => {
                let no_viewer = || {
                    format!(
                        "no viewer listens at {url} \
                         (help: start `rerun`, or write a file with --save)"
                    )
                };
                probe(url).with_context(no_viewer)?;
                (builder.connect_grpc_opts(url.as_str())).with_context(no_viewer)
            }
        }
    }

    /// Waits until everything of `stream`, which goes here, is written or taken over.
    pub(crate) fn flush(&self, stream: &RecordingStream) -> Result<()> {
        stream
            .flush_with_timeout(FLUSH_TIMEOUT)
            .with_context(|| match self {
                Self::File(path) => format!("{} is incomplete", path.display()),
                Self::Viewer(url) => format!("the viewer at {url} did not take everything"),
            })
    }
}

/// Whether somebody listens where `url` points: rerun itself would wait for a viewer for ever.
fn probe(url: &str) -> Result<()> {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    let address = rest.split('/').next().unwrap_or(rest);
    let mut failure = io::Error::from(io::ErrorKind::AddrNotAvailable);
    let addresses = address
        .to_socket_addrs()
        .with_context(|| format!("`{address}` is no HOST:PORT"))?;
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(_) => return Ok(()),
            Err(error) => failure = error,
        }
    }
    bail!(failure)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_viewer_is_named() {
        // Port 9 (discard) is closed on machines of today.
        let url = "rerun+http://127.0.0.1:9/proxy";
        let refused = Destination::Viewer(url.into()).open();
        let error = format!("{:#}", refused.err().expect("refused"));
        assert!(
            error.contains("no viewer listens at") && error.contains("--save"),
            "{error}"
        );
        let refused = Destination::Viewer("nowhere".into()).open();
        assert!(format!("{:#}", refused.err().expect("refused")).contains("HOST:PORT"));
    }
}
