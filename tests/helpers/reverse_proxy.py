"""A small reverse proxy: everything below a sub path goes to a server, all else it refuses."""

import contextlib
import socket
import socketserver
import threading
from collections.abc import Generator

STRAY = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class Proxy(socketserver.ThreadingTCPServer):
    """What stands before a server; each connection carries one request, or a websocket."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, target: int, prefix: str, *, strip: bool, host: str | None = None) -> None:
        """Hand on what is below ``prefix`` to a port, with another Host if one is given."""
        super().__init__(("127.0.0.1", 0), _Connection)
        self.target, self.prefix, self.strip, self.host = target, prefix, strip, host
        self.port = self.server_address[1]
        self.strays: list[str] = []  # request lines of elsewhere
        self.passed: list[str] = []  # requests as the server gets them
        self.open: set[socket.socket] = set()

    def rewritten(self, head: str) -> bytes | None:
        """Return the head of a request for the server; None where it is not below the prefix."""
        line, *headers = head[:-4].split("\r\n")
        verb, path, version = line.split(" ")
        if path != self.prefix and not path.startswith((f"{self.prefix}/", f"{self.prefix}?")):
            self.strays.append(line)
            return None
        if self.strip:
            path = path[len(self.prefix) :]
            path = path if path.startswith("/") else f"/{path}"
        if "upgrade:" not in head.lower():
            headers = [h for h in headers if not h.lower().startswith("connection:")]
            headers.append("Connection: close")
        if self.host is not None:
            headers = [h for h in headers if not h.lower().startswith("host:")]
            headers.append(f"Host: {self.host}")
        self.passed.append(f"{verb} {path}")
        return "\r\n".join([f"{verb} {path} {version}", *headers, "", ""]).encode("latin-1")


class _Connection(socketserver.BaseRequestHandler):
    server: Proxy

    def handle(self) -> None:
        with contextlib.suppress(OSError):
            self._serve()

    def _serve(self) -> None:
        data = b""
        while b"\r\n\r\n" not in data:
            part = self.request.recv(1 << 16)
            if not part:
                return
            data += part
        head, _, rest = data.partition(b"\r\n\r\n")
        sent = self.server.rewritten(head.decode("latin-1") + "\r\n\r\n")
        if sent is None:
            self.request.sendall(STRAY)
            return
        with socket.create_connection(("127.0.0.1", self.server.target)) as upstream:
            ends = {self.request, upstream}
            self.server.open |= ends
            upstream.sendall(sent + rest)
            up = threading.Thread(target=_pump, args=(self.request, upstream), daemon=True)
            up.start()
            _pump(upstream, self.request)
            _shut(self.request)
            up.join(20)
            self.server.open -= ends


def _pump(source: socket.socket, sink: socket.socket) -> None:
    """Hand bytes on until one side ends."""
    with contextlib.suppress(OSError):
        while part := source.recv(1 << 16):
            sink.sendall(part)
    _shut(sink)


def _shut(end: socket.socket) -> None:
    with contextlib.suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)


@contextlib.contextmanager
def proxied(
    target: int, prefix: str = "/rona", *, strip: bool, host: str | None = None
) -> Generator[Proxy]:
    """Run a proxy before the server of a port as long as the block runs."""
    with Proxy(target, prefix, strip=strip, host=host) as proxy:
        thread = threading.Thread(target=proxy.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield proxy
        finally:
            proxy.shutdown()
            thread.join(20)
            for end in tuple(proxy.open):
                _shut(end)
