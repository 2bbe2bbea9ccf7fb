"""`watch`: live page of a run in progress, from a server that only this machine can reach.

A page of another site can also send requests to this machine and, by a host name that changes its address
(DNS rebinding), read the answers. The server therefore requires its own host name and a secret token.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Self
from urllib.parse import parse_qs, urlsplit

from jaxsph.errors import CaseError, JaxsphError
from jaxsph.output.journal import checkpoint_path
from jaxsph.report.frames import Frames
from jaxsph.report.page import record_of, render_page, title_of
from jaxsph.report.space import three

HOST = "127.0.0.1"


class Watch:
    """Context manager that serves the page of a run while the context lasts; the page is updated after every
    chunk.

    Each snapshot is read only once. If reading fails while the file changes, the page shows the error and
    tries again.
    """

    def __init__(self, file: str | Path, port: int = 0) -> None:
        """**Arguments**: `file`: the file of a run or a sweep; `port`: 0 chooses any free port.

        **Raises** FileError if the file cannot be read, CaseError if the port is in use.
        """
        self.path = Path(file)
        self._frames: dict[Path, Frames] = {}
        self._lock = threading.Lock()
        self._token = secrets.token_urlsafe(16)
        self._stamp: tuple[float, ...] = ()
        self._record = b""
        self.latest()  # refuses a file of another kind at once
        try:
            self._server = ThreadingHTTPServer((HOST, port), _answers_of(self))
        except OSError as error:
            raise CaseError(
                f"--port {port}: {error.strerror or error}; give another port, or omit --port"
            ) from None
        self._server.daemon_threads = True

    @property
    def address(self) -> str:
        """Address of the page, including the token that every request needs."""
        return f"http://{HOST}:{self._server.server_address[1]}/{self._token}/"

    def place(self, host: str, path: str) -> str | None:
        """Path of a request relative to the address; None without the token or for another host name."""
        port = self._server.server_address[1]
        token, slash, place = path.removeprefix("/").partition("/")
        knows = hmac.compare_digest(token.encode(), self._token.encode())
        return place if knows and slash and host in (f"{HOST}:{port}", f"localhost:{port}") else None

    @property
    def title(self) -> str:
        """Title of the page."""
        return title_of([self.path])

    def __enter__(self) -> Self:
        """Starts the server in the background."""
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the server."""
        self._server.shutdown()
        self._server.server_close()

    def latest(self) -> tuple[str, bytes]:
        """Hash and compressed contents of the page for the file's current state.

        **Raises** JaxsphError if the file cannot be read.
        """
        with self._lock:
            stamp = _stamp(self.path)
            if stamp != self._stamp or not self._record:
                self._record = record_of([self.path], self._frames)
                self._stamp = stamp
            return hashlib.sha256(self._record).hexdigest()[:16], self._record


def _stamp(path: Path) -> tuple[float, ...]:
    """Modification times of a run's file and of its checkpoint."""
    times = []
    for one in (path, checkpoint_path(path)):
        try:
            times.append(one.stat().st_mtime_ns)
        except FileNotFoundError:
            times.append(0)
    return tuple(times)


def _answers_of(watch: Watch) -> type[BaseHTTPRequestHandler]:
    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            address = urlsplit(self.path)
            place = watch.place(self.headers.get("Host", ""), address.path)
            if place is None:
                self._answer(403, b"open the address that jaxsph watch prints", "text/plain; charset=utf-8")
            elif place == "":
                page = render_page(None, watch.title, three()).encode()
                self._answer(200, page, "text/html; charset=utf-8")
            elif place == "record":
                self._news(parse_qs(address.query).get("known", [""])[0])
            else:
                self._answer(404, b"there is only the page and its record", "text/plain; charset=utf-8")

        def _news(self, known: str) -> None:
            try:
                mark, record = watch.latest()
            except (JaxsphError, OSError) as error:
                self._answer(503, str(error).encode(), "text/plain; charset=utf-8")
                return
            if mark == known:
                self._answer(204, b"", "application/octet-stream")
            else:
                self._answer(200, record, "application/octet-stream", mark)

        def _answer(self, code: int, body: bytes, kind: str, mark: str = "") -> None:
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Referrer-Policy", "no-referrer")
            if mark:
                self.send_header("ETag", mark)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Requests are not logged."""

    return Answers
