"""What a command tells while it works: its log beside a spinner."""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.status import Status


@contextmanager
def progress() -> Iterator[None]:
    """While the block runs, its log lines stand beside a spinner, if stderr is a terminal; warnings are lines."""
    logger = logging.getLogger("predplan")
    handlers: list[logging.Handler] = [_WarningLines(logging.WARNING)]
    level = logger.level
    with contextlib.ExitStack() as stack:
        if sys.stderr.isatty():
            from rich.console import Console

            handlers.append(_Spinner(stack.enter_context(Console(stderr=True).status("reading"))))
            logger.setLevel(logging.INFO)
        for handler in handlers:
            logger.addHandler(handler)
            stack.callback(logger.removeHandler, handler)
        stack.callback(logger.setLevel, level)
        yield


class _WarningLines(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        sys.stderr.write(f"predplan: {record.getMessage()}\n")


class _Spinner(logging.Handler):
    def __init__(self, status: Status) -> None:
        super().__init__(logging.INFO)
        self._status = status

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno < logging.WARNING:
            self._status.update(record.getMessage())
