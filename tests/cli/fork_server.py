"""A process that has imported what ``python -m tactemu`` imports, and forks a process for each command.

These imports take a second of processor time. A forked command is a process like any other: a child of the tests'
process, with its own arguments, folder, environment and pipes. Tests of the start itself run ``python -m tactemu``.
"""

import contextlib
import ctypes
import functools
import gc
import importlib
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import tempfile

IMPORTED = (
    "asyncio", "rich.progress", "rich.table", "tactemu.cli.app", "tactemu.cli.executing", "tactemu.cli.run_output",
    "tactemu.session.session", "firmware_protocols.check",
)  # fmt: skip
"""Modules that most commands import. None initialises Warp: a process that has used a GPU cannot be forked."""
MAX_REQUEST_BYTES = 1 << 17
TIMEOUT_S = 60
PR_SET_CHILD_SUBREAPER = 36


class ForkedCommand(subprocess.Popen):
    """A command ``tactemu`` in a forked process; of the options of ``Popen`` it takes pipes, ``cwd`` and ``env``."""

    def _execute_child(  # Popen makes the pipes before and waits for the process afterwards; here is only its start
        self, args, executable, preexec_fn, close_fds, pass_fds, cwd, env, startupinfo, creationflags, shell,
        p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite, *unused,
    ):  # fmt: skip
        streams = [own if own >= 0 else inherited for own, inherited in zip((p2cread, c2pwrite, errwrite), range(3))]
        request = {
            "arguments": [os.fspath(each) for each in args],
            "cwd": os.fspath(cwd or os.getcwd()),
            "environment": env,
        }
        try:
            connection, server = _server()
            with _adopting_orphans():
                socket.send_fds(connection, [json.dumps(request).encode()], streams)
                said = connection.recv(MAX_REQUEST_BYTES)
            assert said, f"the fork server has ended: {server.wait(TIMEOUT_S)}"
            self.pid, self._child_created = int(said), True
        finally:
            self._close_pipe_fds(p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite)


@contextlib.contextmanager
def _adopting_orphans():
    """Make this process the new parent of each descendant whose parent ends."""
    prctl = ctypes.CDLL(None).prctl
    assert prctl(PR_SET_CHILD_SUBREAPER, 1) == 0
    try:
        yield
    finally:
        prctl(PR_SET_CHILD_SUBREAPER, 0)


@functools.cache
def _server() -> tuple[socket.socket, subprocess.Popen]:
    """Start the fork server of this process. It ends with the connection to it, which is never closed."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(TIMEOUT_S)
    with its:
        command = [sys.executable, "-m", __name__, str(its.fileno())]
        return ours, subprocess.Popen(
            command, pass_fds=[its.fileno()], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip


def main(connection: socket.socket) -> None:
    """Fork a process for each request, until the connection ends; return in such a process, which then has to run."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the tests and their commands
    for module in IMPORTED:
        importlib.import_module(module)
    gc.freeze()
    tests = os.getppid()
    while True:
        text, streams, *_ = socket.recv_fds(connection, MAX_REQUEST_BYTES, 3)
        if not text:
            os._exit(0)
        assert len(os.listdir("/proc/self/task")) == 1, "a forked process has none of the threads that imports started"
        parent = os.fork()
        if not parent:
            if os.fork():
                os._exit(0)
            while os.getppid() != tests:
                os.sched_yield()
            _become(streams, **json.loads(text))
            connection.send(str(os.getpid()).encode())
            return connection.close()
        os.waitpid(parent, 0)
        for stream in streams:
            os.close(stream)


def _become(streams, arguments, cwd, environment) -> None:
    """Make this process the one that was asked for."""
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = None  # that of the environment
    sys.argv[1:], sys.path[0] = arguments, cwd


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
    runpy.run_module("tactemu", run_name="__main__", alter_sys=True)
