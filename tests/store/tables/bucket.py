"""An S3 bucket on loopback: moto's server, which counts the bytes that it answers."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

from werkzeug.serving import make_server

KEY = {"aws_access_key_id": "loopback", "aws_secret_access_key": "loopback"}


class S3Server:
    """A running server; `answered` counts the bytes of its answers."""

    def __init__(self) -> None:
        # Here and not above: every test process collects the files that ask for a bucket.
        import boto3
        from moto.server import DomainDispatcherApplication, create_backend_app

        self.answered = 0
        self.methods: set[str] = set()
        self._app = DomainDispatcherApplication(create_backend_app)
        self._server = make_server("127.0.0.1", 0, self._count, threaded=True)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self.client = boto3.client("s3", endpoint_url=self.url, region_name="us-east-1", **KEY)

    @contextmanager
    def running(self) -> Iterator["S3Server"]:
        thread = Thread(target=self._server.serve_forever)
        thread.start()
        try:
            yield self
        finally:
            self._server.shutdown()
            thread.join()

    def _count(self, environ: dict[str, Any], start: Any) -> Iterable[bytes]:
        self.methods.add(environ["REQUEST_METHOD"])
        for part in self._app(environ, start):
            self.answered += len(part)
            yield part

    def fill(self, bucket: str, folder: Path, prefix: str = "") -> str:
        """Upload a folder; its address."""
        self.client.create_bucket(Bucket=bucket)
        for path in folder.rglob("*"):
            if path.is_file():
                name = path.relative_to(folder).as_posix()
                self.client.upload_file(str(path), bucket, f"{prefix}{name}")
        self.answered, self.methods = 0, set()
        return f"s3://{bucket}/{prefix}".rstrip("/")

    def options(self, **more: Any) -> dict[str, Any]:
        """fsspec's storage options for this server."""
        return {
            "key": "loopback",
            "secret": "loopback",
            "client_kwargs": {"endpoint_url": self.url},
            "skip_instance_cache": True,
            **more,
        }
