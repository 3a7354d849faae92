"""A real server of the API in a thread of the test process."""

import threading
import time

from rona_ui.server import server_of

TOKEN = "a-token-of-the-tests"


def start(hub, gateway, settings):
    server = server_of(hub, gateway, settings)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        if not thread.is_alive():
            raise RuntimeError("the server did not start")
        time.sleep(0.01)
    return server, thread, server.servers[0].sockets[0].getsockname()[1]
