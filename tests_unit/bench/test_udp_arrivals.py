"""When a packet arrived is what the kernel says, however late the process comes to read it."""

import socket
import sys
import threading
import time

import pytest

from arl_fixtures.bench.ports import UdpPort


class StalledClock:
    """A clock whose first reader is held up, as a process that gets no processor."""

    def __init__(self):
        self.asked, self.go_on = threading.Event(), threading.Event()

    @property
    def now_s(self):
        if not self.asked.is_set():
            self.asked.set()
            self.go_on.wait(10.0)
        return time.monotonic()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when a datagram arrived")
def test_a_packet_read_late_bears_the_time_of_its_arrival():
    clock = StalledClock()
    port = UdpPort("udp://127.0.0.1", "127.0.0.1", 0, clock)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"first", ("127.0.0.1", port.bound_port))
            assert clock.asked.wait(10.0)
            sender.sendto(b"second", ("127.0.0.1", port.bound_port))
            sent_s = time.monotonic()
        threading.Event().wait(0.3)  # the stall
        released_s = time.monotonic()
        clock.go_on.set()
        datagrams = []
        while len(datagrams) < 2 and time.monotonic() < released_s + 10.0:
            datagrams += port.receive(0.5)
    finally:
        clock.go_on.set()
        port.close()
    assert [d.payload for d in datagrams] == [b"first", b"second"]
    assert abs(datagrams[1].time_s - sent_s) < 0.5 * (released_s - sent_s)
