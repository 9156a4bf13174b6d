"""Who may reach the page, pure: whoever reaches it can fly.

Three locks. The address that a browser asked for must be one that no name server gives (a stranger's name that points
here would pass for our own page: DNS rebinding). A websocket must come from our own page: browsers say from which. And
beyond this computer a token is asked for: once in the address, then in a cookie that neither scripts nor other sites
see.
"""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

LOOPBACK = "127.0.0.1"
SHORTEST_TOKEN = 16
"""Characters: more than anybody tries over a network."""


@dataclass(frozen=True, slots=True)
class Guard:
    """Of one server."""

    host: str
    """Where it is served."""
    port: int
    token: str | None = None

    @property
    def cookie(self) -> str:
        """Its name: cookies do not know ports, so that it says it."""
        return f"tippath_{self.port}"

    def own_address(self, headers: Mapping[str, str]) -> bool:
        """Whether the request names this computer by number, as localhost, or as what it is served as."""
        try:
            asked = urlsplit(f"//{headers.get('Host', '')}")
            name, port = asked.hostname or "", asked.port or 80
        except ValueError:
            return False
        if port != self.port:
            return False
        if name in ("localhost", self.host.lower()):
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback or not is_loopback(self.host)

    def own_page(self, headers: Mapping[str, str]) -> bool:
        """Whether a websocket was opened by our own page."""
        origin = urlsplit(headers.get("Origin", ""))
        return origin.scheme in ("http", "https") and origin.netloc.lower() == headers.get("Host", "").lower()

    def knows(self, token: str | None) -> bool:
        """Whether this is the token, in a time that does not tell how much of it is right."""
        return self.token is None or hmac.compare_digest((token or "").encode(), self.token.encode())


def is_loopback(host: str) -> bool:
    """Whether only this computer reaches it."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
