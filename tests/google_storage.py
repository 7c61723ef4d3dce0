"""A local server with the part of the JSON API of Google Cloud Storage that gcsfs needs, for tests."""

import base64
import contextlib
import email
import email.policy
import hashlib
import json
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, unquote, urlsplit

_OBJECT = re.compile(r"/(?:download/)?storage/v1/b/([^/]+)/o(?:/(.+))?")
_BUCKET = re.compile(r"/storage/v1/b/([^/]+)")
_UPLOAD = re.compile(r"/upload/storage/v1/b/([^/]+)/o")


class _Server(ThreadingHTTPServer):
    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.buckets: dict[str, dict[str, bytes]] = {}


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002  the name of the base class
        pass

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        query = {name: values[-1] for name, values in parse_qs(url.query).items()}
        if match := _OBJECT.fullmatch(url.path.rstrip("/")):
            bucket, key = match[1], unquote(match[2] or "")
            if bucket not in self.server.buckets:
                self._send_missing("bucket")
            elif not key:
                self._send_json(self._listing(bucket, query.get("prefix", ""), query.get("delimiter", "")))
            elif key not in self.server.buckets[bucket]:
                self._send_missing("object")
            elif query.get("alt") == "media":
                self._send(200, self.server.buckets[bucket][key], "application/octet-stream")
            else:
                self._send_json(self._details(bucket, key))
        elif (match := _BUCKET.fullmatch(url.path)) and match[1] in self.server.buckets:
            self._send_json({"kind": "storage#bucket", "name": match[1]})
        else:
            self._send_missing("bucket")

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if match := _UPLOAD.fullmatch(urlsplit(self.path).path):
            parts = self._parts(content)
            key = json.loads(parts[0])["name"]
            self.server.buckets[match[1]][key] = parts[1]
            self._send_json(self._details(match[1], key))
        else:
            self._delete_batch(content)

    def do_DELETE(self) -> None:
        self._send(self._deleted(self.path), b"", "text/plain")

    def _delete_batch(self, content: bytes) -> None:
        answers = []
        for part in self._parts(content):
            path = urlsplit(part.split()[1].decode()).path
            answers.append(
                f"--answers\r\nContent-Type: application/http\r\n\r\nHTTP/1.1 {self._deleted(path)} -\r\n"
                "Content-Length: 0\r\n\r\n\r\n"
            )
        self._send(200, ("".join(answers) + "--answers--").encode(), "multipart/mixed; boundary=answers")

    def _deleted(self, path: str) -> int:
        match = _OBJECT.fullmatch(urlsplit(path).path)
        assert match is not None
        found = self.server.buckets.get(match[1], {}).pop(unquote(match[2]), None)
        return 404 if found is None else 204

    def _parts(self, content: bytes) -> list[bytes]:
        head = f"Content-Type: {self.headers['Content-Type']}\r\n\r\n".encode()
        message = email.message_from_bytes(head + content, policy=email.policy.HTTP)
        # The contents come from the bytes, because the parser changes the ends of lines.
        boundary = b"--" + str(message.get_boundary()).encode()
        found = [part.partition(b"\n\n" if b"\n\n" in part[:200] else b"\r\n\r\n") for part in content.split(boundary)]
        return [part[2].removesuffix(b"\n").removesuffix(b"\r") for part in found[1:-1]]

    def _listing(self, bucket: str, prefix: str, delimiter: str) -> dict[str, object]:
        items, folders = [], set()
        for key in sorted(self.server.buckets[bucket]):
            if key.startswith(prefix):
                rest = key[len(prefix) :]
                if delimiter and delimiter in rest:
                    folders.add(prefix + rest.partition(delimiter)[0] + delimiter)
                else:
                    items.append(self._details(bucket, key))
        return {"kind": "storage#objects", "items": items, "prefixes": sorted(folders)}

    def _details(self, bucket: str, key: str) -> dict[str, object]:
        content = self.server.buckets[bucket][key]
        digest = base64.b64encode(hashlib.md5(content, usedforsecurity=False).digest()).decode()
        return {
            "kind": "storage#object", "bucket": bucket, "name": key, "size": str(len(content)), "md5Hash": digest,
            "etag": digest, "generation": "1", "updated": "2026-01-01T00:00:00Z",
        }  # fmt: skip

    def _send_missing(self, what: str) -> None:
        error = {"error": {"code": 404, "message": f"The specified {what} does not exist."}}
        self._send(404, json.dumps(error).encode(), "application/json")

    def _send_json(self, value: object) -> None:
        self._send(200, json.dumps(value).encode(), "application/json")

    def _send(self, code: int, content: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


@contextlib.contextmanager
def google_storage_server(*buckets: str) -> Iterator[str]:
    """Run a server with empty buckets and yield its address."""
    server = _Server()
    server.buckets.update({name: {} for name in buckets})
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
