"""What stands between a service and a server on this machine: open, closed, slow, frozen, or full."""

import socket
import threading
import time


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Gate:
    """Passes connections to a port on.

    Closed, it is as if no server were there. Frozen, connections are taken and stay, and no byte passes. Slow, every
    piece of up to 64 KiB waits. Full, requests by HTTP that store something are answered with 507. Requests by HTTP whose
    first line has `denied` in it are answered with 403.
    """

    def __init__(self, port):
        self.behind = ("127.0.0.1", port)
        self.address = ("127.0.0.1", free_port())
        self.url = "http://%s:%d" % self.address
        self.sockets = set()
        self.passes = threading.Event()
        self.passes.set()
        self.delay, self.is_full, self.denied = 0, False, None
        self.open()

    def open(self):
        self.listener = socket.create_server(self.address, backlog=128)
        threading.Thread(target=self.accept, args=[self.listener], daemon=True).start()

    def close(self):
        """No connection is taken from now on, and those that are there break."""
        # a thread that waits in accept would keep the listener
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        for each in list(self.sockets):
            shut(each)

    def freeze(self):
        self.passes.clear()

    def thaw(self):
        self.passes.set()

    def accept(self, listener):
        while True:
            try:
                near = listener.accept()[0]
            except OSError:
                return
            try:
                far = socket.create_connection(self.behind)
            except OSError:
                near.close()
                continue
            self.sockets |= {near, far}
            for source, target, is_request in [(near, far, True), (far, near, False)]:
                threading.Thread(target=self.copy, args=[source, target, is_request], daemon=True).start()

    def copy(self, source, target, is_request):
        try:
            while chunk := source.recv(1 << 16):
                self.passes.wait()
                time.sleep(self.delay)
                if self.is_full and is_request and chunk.startswith((b"PUT ", b"POST ")):
                    source.sendall(b"HTTP/1.1 507 Insufficient Storage\r\ncontent-length: 0\r\nconnection: close\r\n\r\n")
                    raise OSError("full")
                if is_request and self.denied and self.denied in chunk.split(b"\r\n")[0]:
                    source.sendall(b"HTTP/1.1 403 Forbidden\r\ncontent-length: 0\r\nconnection: close\r\n\r\n")
                    raise OSError("denied")
                target.sendall(chunk)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            shut(source)
            shut(target)
        self.sockets.discard(source)


def shut(each):
    try:
        each.shutdown(socket.SHUT_RDWR)
    except OSError:
        pass
