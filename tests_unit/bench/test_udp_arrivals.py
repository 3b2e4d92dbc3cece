"""When a packet arrived is what the kernel says, however late the process comes to read it."""

import socket
import struct
import sys
import threading
import time

import pytest

from arl_fixtures.bench import ports
from arl_fixtures.bench.ports import SO_TIMESTAMPNS, UdpPort

PATIENCE_S = 300.0


class StalledClock:
    """A clock whose first reader is held up, as a process that gets no processor."""

    def __init__(self):
        self.asked, self.go_on = threading.Event(), threading.Event()

    @property
    def now_s(self):
        if not self.asked.is_set():
            self.asked.set()
            self.go_on.wait(PATIENCE_S)
        return time.monotonic()


@pytest.fixture
def stamping():
    """The kernel has begun to note arrivals, which it does some time after the first socket has asked for that."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        listener.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(PATIENCE_S)
        for _ in range(100_000):
            sender.sendto(b"x", listener.getsockname())
            sent_ns = time.time_ns()
            _, ((_, _, stamp),), _, _ = listener.recvmsg(10, 256)
            seconds, nanoseconds = struct.unpack("@qq", stamp)
            # else it is the time of reading
            if seconds * 1_000_000_000 + nanoseconds <= sent_ns:
                break
        else:
            pytest.fail("the kernel never tells when a datagram arrived")
        yield


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when a datagram arrived")
@pytest.mark.usefixtures("stamping")
def test_a_packet_read_late_bears_the_time_of_its_arrival():
    clock = StalledClock()
    port = UdpPort("udp://127.0.0.1", "127.0.0.1", 0, clock)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"first", ("127.0.0.1", port.bound_port))
            assert clock.asked.wait(PATIENCE_S)
            before_s = time.monotonic()
            sender.sendto(b"second", ("127.0.0.1", port.bound_port))
            sent_s = time.monotonic()
        threading.Event().wait(0.3)  # the stall
        clock.go_on.set()
        datagrams = []
        deadline_s = time.monotonic() + PATIENCE_S
        while len(datagrams) < 2 and time.monotonic() < deadline_s:
            datagrams += port.receive(0.5)
    finally:
        clock.go_on.set()
        port.close()
    assert [d.payload for d in datagrams] == [b"first", b"second"]
    # the clocks of bench and host are read one after the other
    assert before_s - 0.05 < datagrams[1].time_s < sent_s + 0.05


def test_a_process_held_up_between_two_clocks_does_not_take_that_for_waiting(monkeypatch):
    """The bench clock is read, then the host's: what passed between, if it was long, was no waiting of the packet."""
    now_s, held_up_s = [100.0], [2.0, 3.0]

    class Clock:
        @property
        def now_s(self):
            return now_s[0]

    def waited_s(_about):
        now_s[0] += held_up_s.pop() if held_up_s else 1e-5
        return now_s[0] - 99.5

    monkeypatch.setattr(ports, "_waited_s", waited_s)
    port = UdpPort("udp://127.0.0.1", "127.0.0.1", 0, Clock())
    port.close()
    assert port._arrival_s([]) == pytest.approx(99.5, abs=1e-3)
