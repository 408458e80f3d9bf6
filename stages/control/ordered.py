"""The runs that a task's settings order: which of them there are, and where they lie."""

from __future__ import annotations

from predplan.control.environments import EnvironmentSettings
from predplan.control.running import Order
from predplan.control.training import Schedule
from predplan.errors import InputError
from stages.common import TaskStage
from stages.settings import ConditionSettings


def orders(stage: TaskStage) -> list[Order]:
    """Condition by condition, method by method, seed by seed. Raises InputError for an unknown task or method."""
    task = stage.task
    twice = sorted({name for name in task.ablations if name in task.methods})
    if twice:
        raise InputError(f"control.tasks.{stage.name}.ablations: {', '.join(twice)} stand under methods as well")
    schedule = Schedule(task.steps, task.copies, task.length)
    threads = 1 if stage.settings.workers > 1 or stage.settings.scheduler else 2
    found = []
    for i, condition in enumerate(task.conditions):
        observed = EnvironmentSettings(task.task, condition.noise, condition.drop, task.horizon, threads=threads)
        for method in (*task.methods, *(task.ablations if i == 0 else ())):
            found += [Order(observed, method, schedule, seed) for seed in range(task.seeds)]
    return found


def condition_name(condition: ConditionSettings | EnvironmentSettings) -> str:
    """Part of names of files and folders."""
    return f"noise{condition.noise:g}-drop{condition.drop:g}"


def policy_name(order: Order) -> str:
    """Folder of a policy, of which one a method and condition is kept."""
    return f"{order.method}-{condition_name(order.task)}"
