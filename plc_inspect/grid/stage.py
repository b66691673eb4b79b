# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks of one kind, of which the ledger knows those that are finished."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from plc_inspect.grid.engine import Task
from plc_inspect.grid.ledger import Ledger


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Tasks of one kind."""

    name: str
    """In the ledger."""
    tasks: Sequence[Task]
    keys: dict[str, str]
    """Digest of what each task depends on; one finished with the same key is not run again."""
    renew: Callable[[str, dict[str, Any]], str] | None = None
    """Returns the key to keep, from the name and answer of a task."""

    def find_key(self, name: str, answer: dict[str, Any] | None) -> str:
        """Return the key of a task with its answer, None of one that failed."""
        return self.keys[name] if answer is None or not self.renew else self.renew(name, answer)

    def divide(self, ledger: Ledger) -> tuple[dict[str, dict[str, Any]], list[Task]]:
        """Return the answers of finished tasks by name, and the other tasks."""
        answers, left = {}, []
        for task in self.tasks:
            known = ledger.find_task(self.name, task.name)
            if known is not None and known[0] == self.find_key(task.name, known[1]):
                answers[task.name] = known[1]
            else:
                left.append(replace(task, stage=self.name))
        return answers, left
