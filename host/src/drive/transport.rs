//! Connections to a board: serial port, TCP, unix socket. Opens them, and moves bytes with short
//! waits.
//!
//! A [`Transport`] is a line that may lose, delay or damage bytes; it knows no frames. An error
//! means that the line is lost and must be reopened.

#[cfg(feature = "serial")]
use crate::drive::host_clock::HostClock;
use crate::text::refusal::{Refusal, refusal};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
#[cfg(unix)]
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// How long a reader waits for bytes: the sender has to be polled this often.
const WAIT: Duration = Duration::from_millis(2);
/// How long a writer waits for room before the line counts as gone.
const WRITE_PATIENCE: Duration = Duration::from_secs(2);
/// How long a connection may take.
const CONNECT_PATIENCE: Duration = Duration::from_secs(2);
/// Default line rate of a serial port: common to USB adapters and boards.
pub const BAUD_DEFAULT: u32 = 1_000_000;

/// A line of bytes.
pub trait Transport: Send {
    /// Waits a moment for bytes and returns how many arrived; 0 if none did.
    ///
    /// # Errors
    /// The line is lost.
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Sends all bytes.
    ///
    /// # Errors
    /// The line is lost.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Sends as many bytes as there is room for and returns how many; all, if a line cannot report
    /// it.
    ///
    /// # Errors
    /// The line is lost.
    fn send_some(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.send(bytes).map(|()| bytes.len())
    }
}

/// Where a board is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Port {
    /// A serial port by name.
    Serial(String),
    /// `HOST:PORT`.
    Tcp(String),
    /// A unix socket.
    Unix(PathBuf),
}

impl FromStr for Port {
    type Err = Refusal;

    fn from_str(text: &str) -> Result<Self, Refusal> {
        let malformed = || {
            let text: String = text.chars().take(200).collect();
            refusal!("port `{text}`: write a serial port's name, tcp:HOST:PORT or unix:PATH")
        };
        if let Some(address) = text.strip_prefix("tcp:") {
            let (host, port) = address.rsplit_once(':').ok_or_else(malformed)?;
            if host.is_empty() || port.parse::<u16>().is_err() {
                return Err(malformed());
            }
            return Ok(Port::Tcp(address.to_string()));
        }
        if let Some(path) = text.strip_prefix("unix:") {
            if path.is_empty() {
                return Err(malformed());
            }
            if cfg!(not(unix)) {
                return Err(refusal!(
                    "port `{text}`: this system has no unix sockets; use tcp:HOST:PORT"
                ));
            }
            return Ok(Port::Unix(PathBuf::from(path)));
        }
        if text.is_empty() {
            return Err(malformed());
        }
        Ok(Port::Serial(text.to_string()))
    }
}

impl std::fmt::Display for Port {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Port::Serial(name) => f.write_str(name),
            Port::Tcp(address) => write!(f, "tcp:{address}"),
            Port::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

impl Port {
    /// Opens the line; `baud` applies to serial ports.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(&self, baud: u32) -> io::Result<Box<dyn Transport>> {
        match self {
            Port::Serial(name) => serial(name, baud),
            Port::Tcp(address) => Ok(Box::new(Socket(connect(address)?))),
            #[cfg(unix)]
            Port::Unix(path) => Ok(Box::new(Socket(of_unix(UnixStream::connect(path)?)?))),
            #[cfg(not(unix))]
            Port::Unix(_) => Err(io::Error::from(ErrorKind::Unsupported)),
        }
    }
}

#[cfg(feature = "serial")]
fn serial(name: &str, baud: u32) -> io::Result<Box<dyn Transport>> {
    let port = serialport::new(name, baud).timeout(WAIT).open()?;
    Ok(Box::new(Serial(port)))
}

/// Refuses: there are no serial ports in this build.
#[cfg(not(feature = "serial"))]
fn serial(name: &str, _baud: u32) -> io::Result<Box<dyn Transport>> {
    let problem = format!(
        "{name}: this build of headway has no serial ports (feature `serial`): use tcp:HOST:PORT"
    );
    Err(io::Error::new(ErrorKind::Unsupported, problem))
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::from(ErrorKind::AddrNotAvailable);
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_PATIENCE) {
            Ok(stream) => return of_tcp(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn of_tcp(stream: TcpStream) -> io::Result<TcpStream> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(WAIT))?;
    stream.set_write_timeout(Some(WRITE_PATIENCE))?;
    // Acknowledgements must not wait for more bytes.
    stream.set_nodelay(true)?;
    Ok(stream)
}

#[cfg(unix)]
fn of_unix(stream: UnixStream) -> io::Result<UnixStream> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(WAIT))?;
    stream.set_write_timeout(Some(WRITE_PATIENCE))?;
    Ok(stream)
}

struct Socket<S>(S);

impl<S: Read + Write + Send> Transport for Socket<S> {
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer) {
            // A closed socket returns an empty read.
            Ok(0) => Err(io::Error::from(ErrorKind::UnexpectedEof)),
            result => patient(result),
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }

    fn send_some(&mut self, bytes: &[u8]) -> io::Result<usize> {
        patient(self.0.write(bytes))
    }
}

#[cfg(feature = "serial")]
struct Serial(Box<dyn serialport::SerialPort>);

#[cfg(feature = "serial")]
impl Transport for Serial {
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        patient(self.0.read(buffer))
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        // The port's timeout is a reader's: go on for a writer's patience, in which the host runs.
        let begun = std::time::Instant::now();
        let mut clock = HostClock::default();
        let mut rest = bytes;
        while !rest.is_empty() {
            let written = patient(self.0.write(rest))?;
            clock.round(begun.elapsed().as_micros() as u64);
            match written {
                0 if clock.counted() > WRITE_PATIENCE => {
                    return Err(io::Error::from(ErrorKind::TimedOut));
                }
                written => rest = rest.get(written..).unwrap_or_default(),
            }
        }
        Ok(())
    }
}

impl Port {
    /// Others than this computer reach it.
    pub fn is_beyond_this_computer(&self) -> bool {
        let Port::Tcp(place) = self else {
            return false;
        };
        let places = place.to_socket_addrs();
        places.is_ok_and(|mut places| places.any(|place| !place.ip().is_loopback()))
    }
}

/// Nothing yet is no error.
fn patient(result: io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
            ) =>
        {
            Ok(0)
        }
        result => result,
    }
}

/// Waits for a host: the other end of a TCP or unix [`Port`].
#[derive(Debug)]
pub enum Listener {
    /// TCP.
    Tcp(TcpListener),
    /// Unix socket, and the file to remove at the end.
    #[cfg(unix)]
    Unix(UnixListener, PathBuf),
}

impl Listener {
    /// Listens; a serial port cannot.
    ///
    /// # Errors
    /// What the system says.
    pub fn bind(port: &Port) -> io::Result<Listener> {
        match port {
            Port::Serial(_) => Err(io::Error::new(
                ErrorKind::Unsupported,
                "listen on tcp:HOST:PORT or unix:PATH",
            )),
            Port::Tcp(address) => {
                let listener = TcpListener::bind(address)?;
                listener.set_nonblocking(true)?;
                Ok(Listener::Tcp(listener))
            }
            #[cfg(unix)]
            Port::Unix(path) => {
                let listener = UnixListener::bind(path)?;
                listener.set_nonblocking(true)?;
                Ok(Listener::Unix(listener, path.clone()))
            }
            #[cfg(not(unix))]
            Port::Unix(_) => Err(io::Error::from(ErrorKind::Unsupported)),
        }
    }

    /// The port on which it listens: for TCP port 0, the one that the system chose.
    ///
    /// # Errors
    /// What the system says.
    pub fn port(&self) -> io::Result<Port> {
        match self {
            Listener::Tcp(listener) => Ok(Port::Tcp(listener.local_addr()?.to_string())),
            #[cfg(unix)]
            Listener::Unix(_, path) => Ok(Port::Unix(path.clone())),
        }
    }

    /// A host that has connected since the last call. Its line waits neither for bytes nor for room
    /// ([`Transport::send_some`]), so that no host blocks the others.
    ///
    /// # Errors
    /// What the system says.
    pub fn accept(&self) -> io::Result<Option<Box<dyn Transport>>> {
        let accepted: io::Result<Box<dyn Transport>> = match self {
            Listener::Tcp(listener) => listener
                .accept()
                .and_then(|(stream, _)| of_tcp(stream))
                .and_then(|stream| stream.set_nonblocking(true).map(|()| stream))
                .map(|stream| Box::new(Socket(stream)) as _),
            #[cfg(unix)]
            Listener::Unix(listener, _) => listener
                .accept()
                .and_then(|(stream, _)| stream.set_nonblocking(true).map(|()| stream))
                .map(|stream| Box::new(Socket(stream)) as _),
        };
        match accepted {
            Ok(transport) => Ok(Some(transport)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(None),
            Err(error) => Err(error),
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        #[cfg(unix)]
        if let Listener::Unix(_, path) = self {
            // A file that no longer exists needs no removal.
            let _ = std::fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_are_read_and_written() {
        for text in [
            "/dev/ttyACM0",
            "COM3",
            "tcp:localhost:7000",
            "tcp:[::1]:7000",
        ] {
            let port: Port = text.parse().unwrap();
            assert_eq!(port.to_string(), text);
        }
        for text in ["", "tcp:", "tcp:host", "tcp::1", "tcp:host:99999", "unix:"] {
            assert!(text.parse::<Port>().is_err(), "{text}");
        }
    }

    #[test]
    fn bytes_go_through_tcp_and_an_end_is_an_error() {
        let listener = Listener::bind(&Port::Tcp("127.0.0.1:0".into())).unwrap();
        let mut host = listener.port().unwrap().open(BAUD_DEFAULT).unwrap();
        let mut board = loop {
            if let Some(board) = listener.accept().unwrap() {
                break board;
            }
        };
        let mut buffer = [0; 16];
        assert_eq!(host.receive(&mut buffer).unwrap(), 0);
        board.send(b"hello").unwrap();
        let mut seen = Vec::new();
        while seen.len() < 5 {
            let count = host.receive(&mut buffer).unwrap();
            seen.extend_from_slice(&buffer[..count]);
        }
        assert_eq!(seen, b"hello");
        drop(board);
        let gone = (0..1000).any(|_| host.receive(&mut buffer).is_err());
        assert!(gone);
    }
}
