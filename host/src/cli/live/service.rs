//! The answers of the page's server: request -> page, status as JSON, a command for the stream's loop.

use super::access::{Access, Asked};
use super::orders::order;
use super::{NotTaken, Shared};
use http_body_util::{BodyExt, Full, Limited};
use hyper::body::{Body, Bytes, Incoming};
use hyper::header::{CONTENT_TYPE, HOST, HeaderName, HeaderValue, ORIGIN};
use hyper::{Method, Request, Response, StatusCode};
use serde_json::json;
use std::sync::Arc;
use std::time::Duration;

/// Longest order, bytes.
const ORDER_BYTES_MAX: usize = 64;
/// For an order to arrive.
const ORDER_PATIENCE: Duration = Duration::from_secs(2);
/// What every answer carries: not kept, not framed, no address given away.
const HEADERS: [(&str, &str); 4] = [
    ("cache-control", "no-store"),
    ("x-frame-options", "DENY"),
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
];
const TEXT: &str = "text/plain";

/// Status, kind and body of an answer.
type Answer = (StatusCode, &'static str, Bytes);

/// What all connections share.
pub(super) struct Service {
    access: Access,
    page: Bytes,
    shared: Arc<Shared>,
}

impl Service {
    pub(super) fn new(access: Access, page: String, shared: Arc<Shared>) -> Service {
        Service {
            access,
            page: page.into(),
            shared,
        }
    }

    /// The answer to a request, whose body may still be in transit.
    pub(super) async fn prepare(&self, request: Request<Incoming>) -> Response<Full<Bytes>> {
        let (status, kind, body) = self.answer(request).await;
        let mut response = Response::new(Full::new(body));
        *response.status_mut() = status;
        let headers = response.headers_mut();
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
        for (name, value) in HEADERS {
            headers.insert(
                HeaderName::from_static(name),
                HeaderValue::from_static(value),
            );
        }
        response
    }

    async fn answer(&self, request: Request<Incoming>) -> Answer {
        let is_post = request.method() == Method::POST;
        let is_get = request.method() == Method::GET;
        // A header that is no text is as wrong as a foreign one.
        let named = |name: HeaderName| -> Vec<&str> {
            let values = request.headers().get_all(name).into_iter();
            values
                .map(|value| value.to_str().unwrap_or_default())
                .collect()
        };
        let target = request.uri().to_string();
        let asked = self
            .access
            .let_in(is_post, &target, &named(HOST), &named(ORIGIN));
        match asked {
            Err(refused) => {
                let status = StatusCode::from_u16(refused.status());
                (status.unwrap_or(StatusCode::FORBIDDEN), TEXT, Bytes::new())
            }
            Ok(_) if !is_get && !is_post => (StatusCode::METHOD_NOT_ALLOWED, TEXT, Bytes::new()),
            Ok(Asked::Page) => (
                StatusCode::OK,
                "text/html; charset=utf-8",
                self.page.clone(),
            ),
            Ok(Asked::Status) => (StatusCode::OK, "application/json", self.status()),
            Ok(Asked::Order) => {
                let (status, text) = match order_text(request.into_body()).await {
                    Ok(order) => self.order(&order),
                    Err(status) => (status, "a command is a line of at most 64 bytes"),
                };
                (status, TEXT, Bytes::from_static(text.as_bytes()))
            }
        }
    }

    fn status(&self) -> Bytes {
        let (snapshot, at) = self.shared.snapshot();
        let status = json!({ "print": snapshot, "age_s": at.elapsed().as_secs_f64() });
        status.to_string().into()
    }

    fn order(&self, text: &str) -> (StatusCode, &'static str) {
        let Some(control) = order(text) else {
            return (
                StatusCode::BAD_REQUEST,
                "orders: pause, resume, override 1 to 200, flow 10 to 200, abort, stop",
            );
        };
        match self.shared.order(control) {
            Ok(()) => (StatusCode::ACCEPTED, ""),
            Err(NotTaken::Full) => (
                StatusCode::SERVICE_UNAVAILABLE,
                "too many commands are queued; try again in a second",
            ),
            Err(NotTaken::Over) => (StatusCode::GONE, "the print is over"),
        }
    }
}

/// The body as text, or why it is not read: too long by its header or its contents, or too late.
async fn order_text(body: Incoming) -> Result<String, StatusCode> {
    if body.size_hint().lower() > ORDER_BYTES_MAX as u64 {
        return Err(StatusCode::PAYLOAD_TOO_LARGE);
    }
    let whole = Limited::new(body, ORDER_BYTES_MAX).collect();
    let read = tokio::time::timeout(ORDER_PATIENCE, whole).await;
    let bytes = read
        .map_err(|_| StatusCode::REQUEST_TIMEOUT)?
        .map_err(|_| StatusCode::PAYLOAD_TOO_LARGE)?
        .to_bytes();
    String::from_utf8(bytes.into()).map_err(|_| StatusCode::BAD_REQUEST)
}
