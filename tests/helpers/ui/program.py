"""`rona serve` that can be killed in the middle of work, and started again on the same folder."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from rona_ui.resources import demo_session
from tests.helpers.ui.browser_driver import REPOSITORY, TOKEN, answers, free_port, wait_for


class Program:
    """`rona serve` on one port; it can be killed, with all that it started, and started anew."""

    def __init__(self, sessions: Path) -> None:
        self.sessions, self.port = sessions, free_port()
        self.address = f"http://127.0.0.1:{self.port}/"
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "rona_ui", "serve", str(demo_session()), "--no-open"]
        command += ["--pace", "0"]
        command += ["--port", str(self.port), "--sessions", str(self.sessions)]
        environment = {**os.environ, "RONA_TOKEN": TOKEN, "OMP_NUM_THREADS": "1"}
        self.log = (self.sessions / "server.log").open("ab")
        self.process = subprocess.Popen(
            command, cwd=REPOSITORY, env=environment, stdout=self.log, stderr=self.log,
            start_new_session=True,
        )  # fmt: skip
        wait_for(lambda: answers(self.address), "the server")

    def kill(self) -> None:
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(20)
        self.log.close()
