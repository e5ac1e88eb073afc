//! The sink of a view, as users write it: `spawn`, `connect[=URL]`, `serve[=PORT]` or `save=FILE`.

use std::{
    fmt,
    path::{Path, PathBuf},
    str::FromStr,
};

/// The port that Rerun viewers listen on by default.
const VIEWER_PORT: u16 = 9876;

/// Where a view shows recordings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Sink {
    /// A viewer on this machine. The view starts one if none listens yet.
    Spawn,
    /// A viewer that already listens.
    Connect {
        /// The viewer's URL, such as `rerun+http://127.0.0.1:9876/proxy`.
        url: String,
    },
    /// Viewers that connect to the view.
    Serve {
        /// The port that the view listens on.
        port: u16,
    },
    /// A Rerun file.
    Save {
        /// The file to write. Its name usually ends in `.rrd`.
        path: PathBuf,
    },
}

impl FromStr for Sink {
    type Err = String;

    fn from_str(text: &str) -> Result<Sink, String> {
        let (name, value) = match text.split_once('=') {
            Some((name, value)) => (name, Some(value)),
            None => (text, None),
        };
        match (name, value) {
            ("spawn", None) => Ok(Sink::Spawn),
            ("connect", None) => Ok(Sink::Connect { url: Sink::viewer_url("127.0.0.1", VIEWER_PORT) }),
            ("connect", Some(address)) => Ok(Sink::Connect { url: parse_url(address)? }),
            ("serve", None) => Ok(Sink::Serve { port: VIEWER_PORT }),
            ("serve", Some(port)) => match port.parse() {
                Ok(port) if port > 0 => Ok(Sink::Serve { port }),
                _ => Err(format!("`{port}` is not a port; write a number from 1 to 65535, as in `serve=9876`")),
            },
            ("save", Some(path)) if !path.is_empty() => Ok(Sink::Save { path: path.into() }),
            ("save", _) => Err("`save` needs a file, as in `save=run.rrd`".to_owned()),
            _ => Err(format!("`{text}` is none of `spawn`, `connect[=URL]`, `serve[=PORT]`, `save=FILE`")),
        }
    }
}

impl Sink {
    /// The file that the sink writes, if it writes one.
    pub fn file(&self) -> Option<&Path> {
        if let Sink::Save { path } = self { Some(path) } else { None }
    }

    /// The URL of the viewer at a host and port.
    pub fn viewer_url(host: &str, port: u16) -> String {
        format!("rerun+http://{host}:{port}/proxy")
    }

    /// The host and port of a viewer's URL, or `None` if the URL has none.
    pub fn address(url: &str) -> Option<(&str, u16)> {
        let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
        let (host, port) = rest.split('/').next()?.rsplit_once(':')?;
        Some((host.trim_start_matches('[').trim_end_matches(']'), port.parse().ok()?))
    }
}

impl fmt::Display for Sink {
    /// Writes the sink so that it parses to the same sink again.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Sink::Spawn => f.write_str("spawn"),
            Sink::Connect { url } => write!(f, "connect={url}"),
            Sink::Serve { port } => write!(f, "serve={port}"),
            Sink::Save { path } => write!(f, "save={}", path.display()),
        }
    }
}

/// Parses a whole URL, or a host with or without a port.
fn parse_url(address: &str) -> Result<String, String> {
    let whole = if address.contains("://") {
        address.to_owned()
    } else if address.contains(':') {
        format!("rerun+http://{address}/proxy")
    } else {
        Sink::viewer_url(address, VIEWER_PORT)
    };
    let known = ["rerun://", "rerun+http://", "rerun+https://"].iter().any(|scheme| whole.starts_with(scheme));
    match Sink::address(&whole) {
        Some((host, _)) if known && !host.is_empty() => Ok(whole),
        _ => Err(format!("`{address}` is not a viewer's address; write it as `rerun+http://127.0.0.1:9876/proxy`")),
    }
}

#[cfg(test)]
mod tests {
    use super::Sink;

    #[test]
    fn every_form_of_a_sink_is_understood() {
        let connect = |url: &str| Ok(Sink::Connect { url: url.to_owned() });
        assert_eq!("spawn".parse(), Ok(Sink::Spawn));
        assert_eq!("connect".parse(), connect("rerun+http://127.0.0.1:9876/proxy"));
        assert_eq!("connect=desk".parse(), connect("rerun+http://desk:9876/proxy"));
        assert_eq!("connect=[::1]:99".parse(), connect("rerun+http://[::1]:99/proxy"));
        assert_eq!("connect=rerun+http://a:1/proxy".parse(), connect("rerun+http://a:1/proxy"));
        assert_eq!("serve=80".parse(), Ok(Sink::Serve { port: 80 }));
        assert_eq!("save=a=b.rrd".parse(), Ok(Sink::Save { path: "a=b.rrd".into() }));
        assert_eq!(Sink::address("rerun+http://[::1]:99/proxy"), Some(("::1", 99)));
    }

    #[test]
    fn a_sink_parses_to_itself_after_it_is_written() {
        for text in ["spawn", "connect=rerun+http://desk:9876/proxy", "serve=80", "save=a=b.rrd"] {
            let sink: Sink = text.parse().unwrap();
            assert_eq!(sink.to_string(), text);
        }
    }

    #[test]
    fn an_unknown_sink_is_refused_with_the_valid_forms() {
        let refused = |text: &str| text.parse::<Sink>().unwrap_err();
        assert!(refused("spwan").contains("`spwan` is none of `spawn`"));
        assert!(refused("save").contains("save=run.rrd"));
        assert!(refused("serve=0").contains("is not a port"));
        assert!(refused("connect=http://x:1").contains("not a viewer's address"));
    }
}
