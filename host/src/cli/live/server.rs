//! The page's server: 127.0.0.1 only, in a thread of its own; the stream survives its end.
//!
//! In: the page as text, connections. Out: answers ([`Service`]), commands for the stream's loop. One thread serves
//! all connections in turn (hyper on tokio), so that no connection waits for another: a client that sends or reads
//! slowly occupies one of [`CONNECTIONS_MAX`] slots and nothing else. Each step of a request has a limit in bytes
//! and in time. Not covered: encryption (the bytes do not leave the machine), files, a second request on a
//! connection.

use super::access::Access;
use super::connections::{CONNECTIONS_MAX, Connections};
use super::service::Service;
use super::{LivePrint, shared};
use crate::cli::error::CliError;
use std::cell::RefCell;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

/// Fewest connections that a page works with.
const CONNECTIONS_MIN: usize = 4;
/// File descriptors that are left to the stream: its line, reopened if it was lost, its log, and the
/// conversation that switches heaters off.
const DESCRIPTORS_KEPT: usize = 16;
/// Before the next connection where the system refuses one.
const ACCEPT_PAUSE: Duration = Duration::from_millis(20);

/// Serves `page` on a free port, or on `port`.
pub(crate) fn serve(page: String, port: u16) -> Result<LivePrint, CliError> {
    let failed = |what: String| CliError::Job(format!("--view: no page can be served: {what}"));
    let of_system = |error: io::Error| failed(error.to_string());
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .map_err(|error| failed(format!("port {port} of 127.0.0.1: {error}")))?;
    let port = listener.local_addr().map_err(of_system)?.port();
    let access = Access::new(port).map_err(|error| failed(error.to_string()))?;
    let url = access.url();
    let (shared, orders) = shared();
    let service = Service::new(access, page, shared.clone());
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .enable_time()
        .build()
        .map_err(of_system)?;
    listener.set_nonblocking(true).map_err(of_system)?;
    let most = connections_for(&listener);
    if most < CONNECTIONS_MIN {
        return Err(failed(
            "too few files may be open at once: allow more (`ulimit -n 256`)".to_string(),
        ));
    }
    let run = move || runtime.block_on(accept(listener, Arc::new(service), most));
    let thread = std::thread::Builder::new().name("page".to_string());
    let thread = thread.spawn(run).map_err(of_system)?;
    Ok(LivePrint {
        shared,
        orders,
        url,
        thread: RefCell::new(Some(thread)),
    })
}

/// How many connections leave the stream its descriptors: what the system grants now, up to the limit.
fn connections_for(listener: &TcpListener) -> usize {
    let granted: Vec<TcpListener> = (0..CONNECTIONS_MAX + DESCRIPTORS_KEPT)
        .map_while(|_| listener.try_clone().ok())
        .collect();
    granted.len().saturating_sub(DESCRIPTORS_KEPT)
}

/// Takes connections for as long as the process lives.
async fn accept(listener: TcpListener, service: Arc<Service>, most: usize) -> io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let mut connections = Connections::new(service, most);
    loop {
        connections.make_room().await;
        match listener.accept().await {
            Ok((stream, _)) => connections.serve(stream),
            // That client has disconnected again.
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset
                ) => {}
            // No descriptor is left, although some were kept: others of this system have them.
            Err(_) => {
                connections.close_oldest();
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
        // An accepted connection is handled before the next one.
        tokio::task::yield_now().await;
    }
}
