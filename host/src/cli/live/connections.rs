//! The connections of the page's server: their number, their lifetime, and which one is closed when another
//! needs its slot.
//!
//! A client that holds a slot without a complete request may be an attacker, or a browser that keeps connections in
//! reserve: where all slots are occupied the oldest of these is closed, after a time in which any client on this
//! machine has sent its request. Connections that are being answered are closed only when their time is over.

use super::service::Service;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio::task::JoinHandle;

/// Connections at once: a browser opens up to six to one server.
pub(super) const CONNECTIONS_MAX: usize = 64;
/// Longest head of a request, bytes: browsers send less than one thousand without cookies.
const HEAD_BYTES_MAX: usize = 8192;
/// Most headers of a request: browsers send some fifteen.
const HEADERS_MAX: usize = 48;
/// For a request's head to arrive.
const HEAD_PATIENCE: Duration = Duration::from_secs(2);
/// For a connection as a whole: 15 MB of a page through a tunnel of 4 Mbit/s.
const LIFE_MAX: Duration = Duration::from_secs(30);
/// So long no connection is closed for another one's sake.
const GRACE: Duration = Duration::from_millis(250);
/// Time between two checks for a free place.
const LOOK: Duration = Duration::from_millis(5);

struct Connection {
    since: Instant,
    /// Its request is there.
    is_answered: Arc<AtomicBool>,
    task: JoinHandle<()>,
}

/// Those that are open.
pub(super) struct Connections {
    service: Arc<Service>,
    most: usize,
    /// The oldest first.
    open: Vec<Connection>,
}

impl Connections {
    pub(super) fn new(service: Arc<Service>, most: usize) -> Connections {
        Connections {
            service,
            most,
            open: Vec::with_capacity(most),
        }
    }

    /// Waits until there is a place.
    pub(super) async fn make_room(&mut self) {
        loop {
            self.open
                .retain(|connection| !connection.task.is_finished());
            if self.open.len() < self.most {
                return;
            }
            let waits = |connection: &Connection| {
                connection.since.elapsed() > GRACE
                    && !connection.is_answered.load(Ordering::Relaxed)
            };
            match self.open.iter().position(waits) {
                Some(oldest) => self.close(oldest),
                None => tokio::time::sleep(LOOK).await,
            }
        }
    }

    /// Serves a connection in a task of its own.
    pub(super) fn serve(&mut self, stream: TcpStream) {
        let is_answered = Arc::new(AtomicBool::new(false));
        let task = serve(stream, self.service.clone(), is_answered.clone());
        self.open.push(Connection {
            since: Instant::now(),
            is_answered,
            task: tokio::spawn(task),
        });
    }

    /// Closes the one that has been open longest.
    pub(super) fn close_oldest(&mut self) {
        if !self.open.is_empty() {
            self.close(0);
        }
    }

    fn close(&mut self, number: usize) {
        self.open.remove(number).task.abort();
    }
}

async fn serve(stream: TcpStream, service: Arc<Service>, is_answered: Arc<AtomicBool>) {
    let answer = |request| {
        let (service, is_answered) = (service.clone(), is_answered.clone());
        async move {
            let answer = service.prepare(request).await;
            is_answered.store(true, Ordering::Relaxed);
            Ok::<_, Infallible>(answer)
        }
    };
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .keep_alive(false)
        .max_headers(HEADERS_MAX)
        .max_header_size(HEAD_BYTES_MAX)
        .max_buf_size(2 * HEAD_BYTES_MAX)
        .header_read_timeout(HEAD_PATIENCE)
        .auto_date_header(false)
        .serve_connection(TokioIo::new(stream), service_fn(answer));
    // A client that has disconnected, or takes too long, does no harm.
    let _ = tokio::time::timeout(LIFE_MAX, connection).await;
}
