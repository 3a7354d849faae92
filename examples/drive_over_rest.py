"""A test harness in a few lines: calibrate the pointer over REST, without any package.

RONA_TOKEN=secret rona serve --no-open &
RONA_TOKEN=secret python examples/drive_over_rest.py
"""

import json
import os
import sys
import time
import urllib.request
from typing import Any


class Rona:
    """The REST interface of a running server."""

    def __init__(self, address: str, token: str) -> None:
        self._api, self._token = f"{address.rstrip('/')}/api/v1", token

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        headers = {"Authorization": f"Bearer {self._token}", "Content-Type": "application/json"}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._api + path, data, headers, method=method)
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)

    def run(self, session: str, activity: str, **fields: Any) -> None:
        """Start an activity and wait until it has ended."""
        job = self.ask("POST", f"/sessions/{session}/jobs/{activity}", fields)
        while job["state"] == "running":
            time.sleep(0.1)
            job = self.ask("GET", f"/jobs/{job['id']}")
        if job["state"] != "done":
            raise SystemExit(f"{activity} {job['state']}: {job['error']}")


def main(address: str, token: str) -> float:
    rona = Rona(address, token)
    session = rona.ask("POST", "/sessions", {"name": "harness", "seed": 3})["id"]
    rona.ask("POST", f"/sessions/{session}/commands/SetPointer", {"kind": "pointer5d"})
    rona.run(session, "StartPointerCapture")
    figures = rona.ask("GET", f"/sessions/{session}/quality")
    value = next(row["value"] for row in figures if row["key"] == "pointer_tip_error_mm")
    print(f"pointer tip error: {value:.2f} mm")
    return value


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8642", os.environ["RONA_TOKEN"])
