"""A survey's server in a thread."""

import threading
from contextlib import contextmanager

from cnca.jobs.survey.serve import SurveyServer


@contextmanager
def serving(folder, port=0):
    with SurveyServer(folder, host="127.0.0.1", port=port) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server.server_port
        finally:
            server.shutdown()
            thread.join()
