"""Programs that run beside a measurement or a test, and waiting: from running import Running, until"""

import re
import signal
import subprocess
import threading
import time

PATIENCE_S = 120.0
"""Nothing takes so long; what waits longer fails."""


def until(what, is_so, patience_s=PATIENCE_S, every_s=0.01):
    """Asks until the answer is true; returns the answer. `what` is the text of a failure, or makes it."""
    end = time.monotonic() + patience_s
    while not (answer := is_so()):
        if time.monotonic() > end:
            raise AssertionError(f"not within {patience_s} s: {what() if callable(what) else what}")
        time.sleep(every_s)
    return answer


class Running:
    """A program from its start to the end of a `with` block; `said` has the lines of its standard error so far."""

    def __init__(self, *command, **options):
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen([str(word) for word in command], **{**streams, **options})
        self.said, self.printed = [], []
        # Read on, so that the program never waits for a reader.
        pairs = ((self.process.stdout, self.printed), (self.process.stderr, self.said))
        self.readers = [threading.Thread(target=self.keep, args=pair, daemon=True) for pair in pairs if pair[0]]
        for reader in self.readers:
            reader.start()

    @staticmethod
    def keep(stream, lines):
        for line in stream:
            lines.append(line)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.ended()

    def wait_for(self, pattern):
        """Waits for a line of standard error with this pattern, and returns the match."""

        def found():
            is_over = not any(reader.is_alive() for reader in self.readers)
            match = next((match for line in list(self.said) if (match := re.search(pattern, line))), None)
            assert match or not is_over, f"ended without saying {pattern!r}: {''.join(self.said)}"
            return match

        try:
            return until(lambda: f"{pattern!r} in {''.join(self.said)}", found)
        except AssertionError:
            self.process.kill()
            raise

    def ended(self, patience_s=PATIENCE_S):
        """Waits for the end; returns standard output."""
        self.process.wait(timeout=patience_s)
        for reader in self.readers:
            reader.join()
        for stream in filter(None, (self.process.stdout, self.process.stderr)):
            stream.close()
        return "".join(self.printed)

    def stop(self, number=signal.SIGINT):
        """Ends the program by a signal, as Ctrl-C does; returns its standard output."""
        self.process.send_signal(number)
        return self.ended()
