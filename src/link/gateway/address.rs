//! Where a gateway listens, as people write it, and where it is found.

use core::str::FromStr;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::path::PathBuf;

/// Address of a gateway.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GatewayAddress {
    /// A TCP address.
    Tcp(SocketAddr),
    /// A link to a PTY.
    Pty(PathBuf),
}

impl GatewayAddress {
    /// Returns whether other machines can reach it: a gateway does not ask for a password.
    pub fn is_exposed(&self) -> bool {
        matches!(self, Self::Tcp(address) if !address.ip().is_loopback())
    }
}

impl core::fmt::Display for GatewayAddress {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Tcp(address) => write!(f, "{address}"),
            Self::Pty(path) => write!(f, "{}", path.display()),
        }
    }
}

/// Where to listen, read from `PORT`, which is on loopback, or `ADDRESS:PORT` (an address, or a name that the system
/// knows).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpAddress(SocketAddr);

/// The text names no address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("got \"{0}\", wanted a port such as 29536, or ADDRESS:PORT")]
pub struct NoTcpAddress(String);

impl TcpAddress {
    /// Returns the address in the system's form.
    pub fn socket(self) -> SocketAddr {
        self.0
    }
}

impl FromStr for TcpAddress {
    type Err = NoTcpAddress;

    fn from_str(text: &str) -> Result<Self, NoTcpAddress> {
        if let Ok(port) = text.parse::<u16>() {
            return Ok(Self((IpAddr::V4(Ipv4Addr::LOCALHOST), port).into()));
        }
        let found = text.to_socket_addrs().ok().and_then(|mut found| found.next());
        found.map(Self).ok_or_else(|| NoTcpAddress(text.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_on_loopback_and_what_others_can_reach_is_known() {
        for (text, wanted, is_exposed) in [
            ("29536", "127.0.0.1:29536", false),
            ("0", "127.0.0.1:0", false),
            ("127.8.8.8:5", "127.8.8.8:5", false),
            ("[::1]:5", "[::1]:5", false),
            ("0.0.0.0:5", "0.0.0.0:5", true),
            ("192.0.2.1:65535", "192.0.2.1:65535", true),
        ] {
            let address = text.parse::<TcpAddress>().unwrap().socket();
            assert_eq!(address, wanted.parse().unwrap(), "{text}");
            assert_eq!(GatewayAddress::Tcp(address).is_exposed(), is_exposed, "{text}");
        }
        for text in ["", "65536", "-1", "nowhere", "192.0.2.1", "192.0.2.1:65536", "/dev/pts/1"] {
            let error = text.parse::<TcpAddress>().unwrap_err().to_string();
            assert!(error.starts_with(&format!("got \"{text}\", wanted")), "{error}");
        }
        assert!(!GatewayAddress::Pty("/tmp/slcan".into()).is_exposed());
    }
}
