from __future__ import annotations

import os
import signal
import threading
import traceback
import weakref

import pytest

from tdcr_planner.planning.interrupts import forget_frames, interrupts_kept


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def test_ctrl_c_is_kept_and_the_handler_comes_back(as_in_a_terminal):
    kept = []
    with interrupts_kept(kept.append):
        interrupt()
        interrupt()
    assert [type(error) for error in kept] == [KeyboardInterrupt, KeyboardInterrupt]
    # A frame kept by a traceback would keep what the library has freed.
    assert all(error.__traceback__ is None for error in kept)
    with pytest.raises(KeyboardInterrupt):
        interrupt()


def test_a_handler_of_ones_own_is_asked_and_decides(as_in_a_terminal):
    seen, kept = [], []
    signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    with interrupts_kept(kept.append):
        interrupt()
    interrupt()
    assert seen == [signal.SIGINT] * 2
    assert kept == []


def test_an_ignored_signal_stays_ignored(as_in_a_terminal):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    kept = []
    with interrupts_kept(kept.append):
        interrupt()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    assert kept == []


def test_an_error_in_the_block_comes_out_and_the_handler_comes_back(as_in_a_terminal):
    with pytest.raises(OSError, match="full"), interrupts_kept(lambda _: None):
        raise OSError("full")
    with pytest.raises(KeyboardInterrupt):
        interrupt()


def test_other_threads_leave_the_handler_alone(as_in_a_terminal):
    handlers = []

    def work():
        with interrupts_kept(lambda _: None):
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert handlers == [signal.default_int_handler]


class Handle:
    pass


def test_an_error_that_is_kept_keeps_nothing_of_the_callbacks(as_in_a_terminal):
    kept = []

    def guarded(handle):
        try:
            raise OSError("no answer")
        except OSError as error:
            kept.append(error)

    def callback(handle):
        guarded(handle)

    def library():
        handle = Handle()
        callback(handle)
        return weakref.ref(handle)

    seen = library()
    assert seen() is not None
    forget_frames(kept[0])
    assert seen() is None
    assert "no answer" in "".join(traceback.format_exception(kept[0]))
