"""Runs a command where every address but loopback is a trap, and writes down what was tried.

    python tests/trap.py RECORD COMMAND…    in RECORD, a line each: "udp 8.8.8.8:53 example.org"

The command runs in a network namespace of its own. It looks online (an interface that is up, an
address, a default route), but the kernel takes every address there is for one of its own: a
connection is refused at once, and the packet is seen by a raw socket. Names that are asked for
are packets too, also to a resolver on loopback. So no process can try anything unseen, whatever
language it is written in. Needs Linux and root, or a user who may make user namespaces.

Where that can't be had, `run` takes a weaker means: an audit hook in every Python process, and
looks at the connections of all the command's processes, the browser's too, many times a second.
"""

import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

NEW_LINK, NEW_ADDRESS, NEW_ROUTE = 16, 20, 24
CREATE, ACK, REQUEST = 0x400, 0x4, 0x1
UP = 1
OWN = "192.0.2.10"  # an address for documentation
TCP, UDP = 6, 17


def _attribute(kind: int, data: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(data), kind) + data + bytes(-len(data) % 4)


def _ask(kind: int, body: bytes) -> None:
    """One request to the kernel. Raises OSError."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0) as netlink:
        flags = REQUEST | ACK | CREATE
        netlink.send(struct.pack("=IHHII", 16 + len(body), kind, flags, 1, 0) + body)
        (error,) = struct.unpack_from("=i", netlink.recv(65536), 16)
    if error:
        raise OSError(-error, os.strerror(-error))


def _set_up(name: str) -> int:
    index = socket.if_nametoindex(name)
    _ask(NEW_LINK, struct.pack("=BxHiII", socket.AF_UNSPEC, 0, index, UP, UP))
    return index


def prepare() -> None:
    """Make this process' network the trap. Raises OSError when that is not allowed."""
    loopback = _set_up("lo")
    # Everything is local: the kernel answers for every address itself.
    for family in (socket.AF_INET, socket.AF_INET6):
        # No prefix, table "local", scope "host", kind "local".
        route = struct.pack("=BBBBBBBBI", family, 0, 0, 0, 255, 3, 254, 2, 0)
        _ask(NEW_ROUTE, route + _attribute(4, struct.pack("=i", loopback)))
    # A pair of linked interfaces, so that programs that look whether they are online find so.
    peer = struct.pack("=BxHiII", 0, 0, 0, 0, 0) + _attribute(3, b"trap1\0")
    linked = _attribute(1, b"veth\0") + _attribute(2, _attribute(1, peer))
    link = struct.pack("=BxHiII", 0, 0, 0, 0, 0)
    _ask(NEW_LINK, link + _attribute(3, b"trap0\0") + _attribute(18, linked))
    index = _set_up("trap0")
    _set_up("trap1")
    own = socket.inet_aton(OWN)
    address = struct.pack("=BBBBI", socket.AF_INET, 32, 0, 0, index)
    _ask(NEW_ADDRESS, address + _attribute(2, own) + _attribute(1, own))


def _name_asked(query: bytes) -> str:
    """The name in a question to a name server."""
    labels, at = [], 12
    while at < len(query) and query[at] and at + query[at] < len(query):
        labels.append(query[at + 1 : at + 1 + query[at]].decode("ascii", "replace"))
        at += 1 + query[at]
    return ".".join(labels)


def attempt(packet: bytes) -> str | None:
    """What an IP packet tries; None for loopback, answers, and the kernel's own messages."""
    if packet[0] >> 4 == 4:
        kind, start = packet[9], (packet[0] & 15) * 4
        target = socket.inet_ntoa(packet[16:20])
        loopback = packet[16] == 127
    else:
        kind, start = packet[6], 40
        target = socket.inet_ntop(socket.AF_INET6, packet[24:40])
        loopback = target == "::1"
    if kind not in (TCP, UDP) or len(packet) < start + 8:
        return None
    (port,) = struct.unpack_from("!H", packet, start + 2)
    if loopback and port != 53:
        return None
    if kind == TCP:
        opens = packet[start + 13] & 0x12 == 0x02  # SYN without ACK
        return f"tcp {target}:{port}" if opens else None
    name = f" {_name_asked(packet[start + 8 :])}" if port == 53 else ""
    return f"udp {target}:{port}{name}"


def _filter() -> bytes:
    """A program for the kernel that lets only packets through which `attempt` has to look at."""
    load_byte, load_half, load_word, equal, end, mask = 0x30, 0x28, 0x20, 0x15, 0x06, 0x54
    code = [
        (load_byte, 0, 0, 0),
        (mask, 0, 0, 0xF0),
        (equal, 2, 0, 0x40),
        (equal, 4, 0, 0x60),
        (end, 0, 0, 0),
        (load_byte, 0, 0, 16),  # IPv4: the first byte of the target
        (equal, 6, 0, 127),
        (end, 0, 0, 512),
        (load_word, 0, 0, 24),  # IPv6: ::1 has one bit
        (equal, 0, 11, 0),
        (load_word, 0, 0, 36),
        (equal, 4, 9, 1),
        (end, 0, 0, 0),
        (load_half, 0, 0, 22),  # IPv4 loopback: questions after names only
        (equal, 6, 0, 53),
        (end, 0, 0, 0),
        (load_half, 0, 0, 42),  # IPv6 loopback, the same
        (equal, 3, 0, 53),
        (end, 0, 0, 0),
        (end, 0, 0, 0),
        (end, 0, 0, 0),
        (end, 0, 0, 512),
    ]
    return b"".join(struct.pack("=HBBI", *line) for line in code)


def watch(record: Path) -> socket.socket:
    """Write attempts down from now on, each once."""
    import ctypes

    wire = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(3))
    program = ctypes.create_string_buffer(_filter())
    wire.setsockopt(
        socket.SOL_SOCKET,
        26,  # SO_ATTACH_FILTER
        struct.pack("HL", len(program.raw) // 8, ctypes.addressof(program)),
    )
    known: set[str] = set()
    file = record.open("a", encoding="utf-8", buffering=1)

    def follow() -> None:
        while True:
            told = attempt(wire.recv(512))
            if told and told not in known:
                known.add(told)
                file.write(f"{told}\n")

    threading.Thread(target=follow, daemon=True).start()
    return wire


def _self_check(record: Path) -> None:
    """A trap that catches nothing would make every program look quiet: try two things."""
    for host, port in (("192.0.2.77", 9), ("127.0.0.53", 53)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.sendto(b"\0" * 12 + b"\5probe\4test\0", (host, port))
    end = threading.Event()
    for _ in range(100):
        text = record.read_text(encoding="utf-8")
        if "udp 192.0.2.77:9" in text and "probe.test" in text:
            return
        end.wait(0.05)
    raise SystemExit("the trap catches nothing")


def attempts(record: Path) -> list[str]:
    """What was tried, without the trap's own probes."""
    lines = record.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if "192.0.2.77:9" not in line and "probe.test" not in line]


def namespace() -> list[str] | None:
    """The words before a command that give it a network of its own; None where not allowed."""
    for words in (["unshare", "--net"], ["unshare", "--map-root-user", "--net"]):
        try:
            probe = [*words, sys.executable, "-I", __file__, "--check"]
            done = subprocess.run(probe, capture_output=True, check=False, timeout=60)
        except OSError:
            return None
        if done.returncode == 0:
            return words
    return None


def run(command: Sequence[Any], record: Path, env: dict[str, str], **options: Any) -> int:
    """Run a command by the strongest means there is and write down what it tries; its exit code."""
    words = namespace()
    if words is not None:
        trapped = [*words, sys.executable, "-I", __file__, record, *command]
        return subprocess.run(trapped, env=env, check=False, **options).returncode
    return run_watched(command, record, env, **options)


# Runs in every Python process below `run_watched`.
AUDIT = """
import os, socket, sys

def tried(event, args):
    if event in ("socket.connect", "socket.sendto", "socket.sendmsg"):
        address = args[1]
        if not isinstance(address, tuple):
            return  # a socket of this machine's file system, or one that is connected already
        host = str(address[0])
        told = f"{event} {host}:{address[1]}"
    elif event in ("socket.getaddrinfo", "socket.gethostbyname"):
        host = args[0].decode() if isinstance(args[0], bytes) else str(args[0] or "localhost")
        told = f"name {host}"
    else:
        return
    if not host.startswith("127.") and host not in ("::1", "localhost"):
        with open(RECORD, "a", encoding="utf-8") as file:
            file.write(told + "\\n")

sys.addaudithook(tried)
"""


def run_watched(command: Sequence[Any], record: Path, env: dict[str, str], **options: Any) -> int:
    """The weaker means: what Python processes try, and the connections of all that can be seen."""
    import psutil

    record.touch()
    hook = record.with_name(f"{record.name}.hook")
    hook.mkdir()
    (hook / "sitecustomize.py").write_text(f"RECORD = {str(record)!r}\n{AUDIT}")
    seen: set[str] = set()
    with subprocess.Popen(command, env={**env, "PYTHONPATH": str(hook)}, **options) as running:
        while running.poll() is None:
            try:
                family = [psutil.Process(running.pid)]
                family += family[0].children(recursive=True)
            except psutil.NoSuchProcess:
                break
            for process in family:
                try:
                    held = process.net_connections("inet")
                except psutil.Error:
                    continue
                for one in held:
                    if one.raddr and not one.raddr.ip.startswith(("127.", "::1", "::ffff:127.")):
                        seen.add(f"{process.pid} {one.raddr.ip}:{one.raddr.port}")
            threading.Event().wait(0.05)
    with record.open("a", encoding="utf-8") as file:
        file.writelines(f"{told}\n" for told in sorted(seen))
    return running.returncode


def main(arguments: Sequence[str]) -> int:
    """Prepare, watch, run; the command's exit code."""
    prepare()
    if arguments[0] == "--check":
        return 0
    record = Path(arguments[0])
    record.touch()
    wire = watch(record)
    _self_check(record)
    code = subprocess.run(arguments[1:], check=False).returncode
    threading.Event().wait(0.2)  # what was sent last is on its way through the socket
    wire.close()
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
