"""Real local sources for live measurements: a process that sends pictures as time goes by.

``python -m benchmarks.live_senders KIND TARGET`` sends H.264 at a constant rate: into a growing
MPEG-TS (``ts``) or fragmented MP4 (``mp4``) file, over UDP (``udp``), or as an RTSP server
(``rtsp``). It prints the Unix time of frame 0; frame i is made i / rate seconds later, and carries
its number in its picture, so that a receiver can tell how old it is.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import socket
import sys
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

BLOCK_PX = 16
BITS = 16


def number_into(rgb: np.ndarray, number: int) -> np.ndarray:
    """A copy with a number written as sixteen black or white blocks into its upper left corner."""
    coded = rgb.copy()
    for bit in range(BITS):
        left = bit * BLOCK_PX
        coded[:BLOCK_PX, left : left + BLOCK_PX] = 235 if number >> bit & 1 else 20
    return coded


def number_of(rgb: np.ndarray) -> int:
    """The number written by :func:`number_into`."""
    middle = BLOCK_PX // 2
    return sum(
        int(rgb[middle - 3 : middle + 3, b * BLOCK_PX + 5 : b * BLOCK_PX + 11].mean() > 128) << b
        for b in range(BITS)
    )


def _file(path: str, kind: str) -> Any:
    options = {"flush_packets": "1"}
    if kind == "mp4":
        options = {
            "movflags": "empty_moov+default_base_moof+frag_every_frame",
            "flush_packets": "1",
        }
    return av.open(path, "w", format={"ts": "mpegts", "mp4": "mp4"}[kind], options=options)


class RtspServer:
    """Serves one client over RTSP with RTP interleaved in TCP (RFC 2326, 10.12).

    The library packs the pictures into RTP packets for a local socket; they are passed on from
    there.
    """

    def __init__(self, port: int) -> None:
        self._inner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._inner.bind(("127.0.0.1", 0))
        self._listening = socket.create_server(("127.0.0.1", port))
        self.port = self._listening.getsockname()[1]
        self._client: socket.socket | None = None

    @property
    def rtp_address(self) -> str:
        """Where the packer sends to."""
        return f"rtp://127.0.0.1:{self._inner.getsockname()[1]}"

    def accept(self) -> None:
        """Wait for a client and answer it until it wants to play."""
        client, _ = self._listening.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        waiting = b""
        while True:
            while b"\r\n\r\n" not in waiting:
                received = client.recv(4096)
                if not received:
                    return
                waiting += received
            request, _, waiting = waiting.partition(b"\r\n\r\n")
            method = request.split(b" ", 1)[0].decode()
            sequence = re.search(rb"CSeq:\s*(\d+)", request, re.IGNORECASE)
            client.sendall(self._answer(method, sequence[1].decode() if sequence else "0"))
            if method == "PLAY":
                break
        client.setblocking(False)
        self._client = client
        self._inner.setblocking(False)
        with contextlib.suppress(BlockingIOError):  # what was packed before does not count
            while True:
                self._inner.recv(65536)

    def _answer(self, method: str, sequence: str) -> bytes:
        body, extra = "", ""
        if method == "OPTIONS":
            extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = (
                "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=cab\r\nc=IN IP4 0.0.0.0\r\nt=0 0\r\n"
                "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
                "a=fmtp:96 packetization-mode=1\r\na=control:track1\r\n"
            )
            extra = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            extra = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "PLAY":
            extra = "Session: 1\r\n"
        return f"RTSP/1.0 200 OK\r\nCSeq: {sequence}\r\n{extra}\r\n{body}".encode()

    def pass_on(self) -> bool:
        """Send what has been packed to the client; False once it is gone."""
        assert self._client is not None
        try:
            while True:
                packet = self._inner.recv(65536)
                self._client.setblocking(True)
                self._client.sendall(b"$\0" + len(packet).to_bytes(2, "big") + packet)
                self._client.setblocking(False)
        except BlockingIOError:
            return True
        except OSError:
            return False

    def close(self) -> None:
        """Release the sockets."""
        for one in (self._client, self._inner, self._listening):
            if one is not None:
                one.close()


def send(
    kind: str,
    target: str,
    pictures: Sequence[np.ndarray],
    rate: int = 25,
    seconds: float = 5.0,
    started: Callable[[float], None] = lambda unix_s: None,
) -> None:
    """Send pictures over and over as time goes by.

    Args:
        kind: "ts", "mp4", "udp" or "rtsp".
        target: File, ``udp://HOST:PORT``, or the port to serve RTSP at.
        pictures: RGB images of one size, each at least 256 pixels wide.
        rate: Frames per second.
        seconds: How long.
        started: Called with the Unix time of frame 0.
    """
    server = RtspServer(int(target)) if kind == "rtsp" else None
    if server is not None:
        server.accept()
        container = av.open(server.rtp_address, "w", format="rtp")
    elif kind == "udp":
        container = av.open(target + "?pkt_size=1316", "w", format="mpegts")
    else:
        container = _file(target, kind)
    try:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = pictures[0].shape[1], pictures[0].shape[0]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.thread_count = 1
        stream.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "g": str(rate),
            "x264-params": "repeat-headers=1",
        }
        begin_s = time.time()
        started(begin_s)
        for index in range(round(rate * seconds)):
            wait_s = begin_s + index / rate - time.time()
            if wait_s > 0:
                time.sleep(wait_s)
            coded = number_into(pictures[index % len(pictures)], index)
            frame = av.VideoFrame.from_ndarray(coded, format="rgb24")
            frame.pts, frame.time_base = index, Fraction(1, rate)
            container.mux(stream.encode(frame))
            if server is not None and not server.pass_on():
                return
        container.mux(stream.encode())
    finally:
        container.close()
        if server is not None:
            server.close()


def main() -> None:
    """Send rendered pictures, or those of a NumPy file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=("ts", "mp4", "udp", "rtsp"))
    parser.add_argument("target", help="file, udp://HOST:PORT, or the port of the RTSP server")
    parser.add_argument("--pictures", type=Path, help="NumPy file, uint8 (N, H, W, 3)")
    parser.add_argument("--rate", type=int, default=25, help="frames per second (default: 25)")
    parser.add_argument("--seconds", type=float, default=5.0, help="how long (default: 5)")
    options = parser.parse_args()
    pictures = (
        np.load(options.pictures)
        if options.pictures
        else [np.full((360, 640, 3), level, np.uint8) for level in range(60, 120, 5)]
    )

    def started(unix_s: float) -> None:
        print(f"{unix_s:.6f}", flush=True)

    send(options.kind, options.target, pictures, options.rate, options.seconds, started)


if __name__ == "__main__":
    sys.exit(main())
