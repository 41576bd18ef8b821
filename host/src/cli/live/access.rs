//! Access control of the page's server, the only access to a moving machine.
//!
//! In: a request's method, target, `Host` and `Origin`. Out: the permitted resource, or the status with
//! which the request is refused. Every path begins with a random token of 128 bits, compared in constant
//! time; a name that only resolves to this machine (DNS rebinding) is refused by its `Host`; a page of
//! another origin by its `Origin`. Requests that move the machine are POST only.

use subtle::ConstantTimeEq;

/// Bytes of the token.
const TOKEN_BYTES: usize = 16;

/// The requested resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Page,
    Status,
    Order,
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refused {
    /// No token, a wrong one, another host or another origin, without distinction.
    Forbidden,
    NotFound,
    Method,
}

impl Refused {
    pub(super) fn status(self) -> u16 {
        match self {
            Refused::Forbidden => 403,
            Refused::NotFound => 404,
            Refused::Method => 405,
        }
    }
}

/// The token and the hosts that are let in.
pub(super) struct Access {
    token: String,
    hosts: [String; 2],
}

impl Access {
    /// With a new token, for a server on this port.
    pub(super) fn new(port: u16) -> Result<Access, getrandom::Error> {
        let mut bytes = [0u8; TOKEN_BYTES];
        getrandom::fill(&mut bytes)?;
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Access::with_token(token, port))
    }

    fn with_token(token: String, port: u16) -> Access {
        let hosts = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{port}"));
        Access { token, hosts }
    }

    pub(super) fn url(&self) -> String {
        format!("http://{}/{}/", self.hosts[0], self.token)
    }

    /// What a request may have. `hosts` and `origins` are all headers of that name.
    pub(super) fn let_in(
        &self,
        is_post: bool,
        target: &str,
        hosts: &[&str],
        origins: &[&str],
    ) -> Result<Asked, Refused> {
        let is_ours = |host: &str| self.hosts.iter().any(|ours| ours == host);
        let is_origin = |origin: &&str| origin.strip_prefix("http://").is_some_and(is_ours);
        let [host] = hosts else {
            return Err(Refused::Forbidden);
        };
        if !is_ours(host) || !origins.iter().all(is_origin) {
            return Err(Refused::Forbidden);
        }
        let path = target.strip_prefix('/').unwrap_or_default();
        let (token, rest) = path.split_once('/').unwrap_or((path, ""));
        if !bool::from(token.as_bytes().ct_eq(self.token.as_bytes())) {
            return Err(Refused::Forbidden);
        }
        match (rest, is_post) {
            ("", false) => Ok(Asked::Page),
            ("status", false) => Ok(Asked::Status),
            ("order", true) => Ok(Asked::Order),
            ("" | "status" | "order", _) => Err(Refused::Method),
            _ => Err(Refused::NotFound),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: nobody gets in without the token, from another host or another page. Method: each part of a
    /// right request is made wrong alone.
    #[test]
    fn only_the_token_this_host_and_this_page_get_in() {
        let access = Access::with_token("0123abcd".into(), 4000);
        let host = ["127.0.0.1:4000"];
        let ask = |target: &str| access.let_in(false, target, &host, &[]);
        assert_eq!(ask("/0123abcd/"), Ok(Asked::Page));
        assert_eq!(ask("/0123abcd/status"), Ok(Asked::Status));
        let order = |hosts: &[&str], origins: &[&str]| {
            access.let_in(true, "/0123abcd/order", hosts, origins)
        };
        assert_eq!(order(&host, &["http://127.0.0.1:4000"]), Ok(Asked::Order));
        assert_eq!(order(&["localhost:4000"], &[]), Ok(Asked::Order));
        assert_eq!(ask("/0123abcd/order"), Err(Refused::Method));
        assert_eq!(ask("/0123abcd/other"), Err(Refused::NotFound));
        for target in [
            "/",
            "",
            "/status",
            "/0123abce/status",
            "/0123abc/status",
            "/0123abcdd/status",
            "//0123abcd/",
            "http://127.0.0.1:4000/0123abcd/",
            "/%30123abcd/",
        ] {
            assert_eq!(ask(target), Err(Refused::Forbidden), "{target}");
        }
        for wrong in [
            &["127.0.0.1:4001"][..],
            &["evil.example:4000"],
            &["127.0.0.1"],
            &["127.0.0.1:4000", "evil.example"],
            &[],
        ] {
            assert_eq!(order(wrong, &[]), Err(Refused::Forbidden), "{wrong:?}");
        }
        for origin in ["http://evil.example", "null", "https://127.0.0.1:4000", ""] {
            assert_eq!(order(&host, &[origin]), Err(Refused::Forbidden), "{origin}");
        }
    }

    #[test]
    fn two_doors_have_two_tokens_of_128_bits() {
        let [one, other] = [0, 1].map(|_| Access::new(1).unwrap().token);
        assert_eq!(one.len(), 2 * TOKEN_BYTES);
        assert_ne!(one, other);
    }
}
