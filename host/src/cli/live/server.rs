//! The page's server: 127.0.0.1 only, some threads that end with the process.
//!
//! In: the page as text, requests. Out: page, status as JSON, orders for the stream's loop. A page that
//! reads slowly holds up one of [`WORKERS`] threads and nothing else. Leaves out: encryption (the bytes do
//! not leave the machine), files.

use super::access::{Access, Asked};
use super::{LivePrint, NotTaken, Shared, shared};
use crate::cli::CliError;
use crate::cli::operator::page_order;
use serde_json::json;
use std::io::Read;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use tiny_http::{Header, Method, Request, Response, Server};

/// Pages that may stall before another has to wait.
const WORKERS: usize = 4;
/// Longest order, bytes.
const ORDER_BYTES_MAX: u64 = 64;
/// What every answer carries: not kept, not framed, no address given away.
const HEADERS: [(&str, &str); 4] = [
    ("Cache-Control", "no-store"),
    ("X-Frame-Options", "DENY"),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
];

struct Service {
    access: Access,
    page: String,
    shared: Arc<Shared>,
}

/// Serves `page` on a free port, or on `port`.
pub(in crate::cli) fn serve(page: String, port: u16) -> Result<LivePrint, CliError> {
    let failed = |what: String| CliError::Job(format!("--view: no page can be served: {what}"));
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .map_err(|error| failed(format!("port {port} of 127.0.0.1: {error}")))?;
    let address = listener.local_addr();
    let port = address.map_err(|error| failed(error.to_string()))?.port();
    let access = Access::new(port).map_err(|error| failed(error.to_string()))?;
    let server =
        Server::from_listener(listener, None).map_err(|error| failed(error.to_string()))?;
    let (server, url) = (Arc::new(server), access.url());
    let (shared, orders) = shared();
    let service = Arc::new(Service {
        access,
        page,
        shared: shared.clone(),
    });
    for _ in 0..WORKERS {
        let (server, service) = (server.clone(), service.clone());
        std::thread::spawn(move || {
            while let Ok(request) = server.recv() {
                // A page that has gone is nobody's loss.
                let _ = service.answer(request);
            }
        });
    }
    Ok(LivePrint {
        shared,
        orders,
        url,
    })
}

impl Service {
    fn answer(&self, mut request: Request) -> std::io::Result<()> {
        let named = |name: &'static str| -> Vec<&str> {
            let headers = request.headers().iter();
            let named = headers.filter(|header| header.field.equiv(name));
            named.map(|header| header.value.as_str()).collect()
        };
        let is_post = *request.method() == Method::Post;
        let is_get = *request.method() == Method::Get;
        let (hosts, origins) = (named("Host"), named("Origin"));
        let asked = self.access.let_in(is_post, request.url(), &hosts, &origins);
        let (status, kind, text) = match asked {
            Err(refused) => (refused.status(), "text/plain", String::new()),
            Ok(_) if !is_get && !is_post => (405, "text/plain", String::new()),
            Ok(Asked::Page) => (200, "text/html; charset=utf-8", self.page.clone()),
            Ok(Asked::Status) => (200, "application/json", self.status()),
            Ok(Asked::Order) => {
                let mut order = String::new();
                let read = request.as_reader().take(ORDER_BYTES_MAX);
                let order = { read }.read_to_string(&mut order).map(|_| order);
                let (status, text) = self.order(&order.unwrap_or_default());
                (status, "text/plain", text.to_owned())
            }
        };
        let mut response = Response::from_string(text).with_status_code(status);
        for (name, value) in HEADERS.iter().chain(&[("Content-Type", kind)]) {
            if let Ok(header) = Header::from_bytes(*name, *value) {
                response.add_header(header);
            }
        }
        request.respond(response)
    }

    fn status(&self) -> String {
        let (snapshot, at) = self.shared.snapshot();
        json!({ "print": snapshot, "age_s": at.elapsed().as_secs_f64() }).to_string()
    }

    fn order(&self, text: &str) -> (u16, &'static str) {
        let Some(control) = page_order(text) else {
            return (
                400,
                "orders: pause, resume, override 1 to 200, flow 10 to 200, abort, stop",
            );
        };
        match self.shared.order(control) {
            Ok(()) => (202, ""),
            Err(NotTaken::Full) => (503, "too many orders wait; try again in a second"),
            Err(NotTaken::Over) => (410, "the print is over"),
        }
    }
}
