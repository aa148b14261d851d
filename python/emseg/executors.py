"""Where jobs are done: in processes of this machine, by a Dask cluster's workers, or under Slurm.

A job is pure and leaves its results complete or not at all, so that it may be tried again anywhere.
"""

from __future__ import annotations

import functools
import importlib
import multiprocessing
import os
import signal
import urllib.parse
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any, Final, Literal, NoReturn, Protocol

from emseg.batch import Job, Outcome, run_job
from emseg.writers import clear_leftovers

__all__ = [
    "DaskCluster",
    "Executor",
    "ExecutorError",
    "LocalProcesses",
    "Slurm",
    "exit_on_signal",
    "make_executor",
]

Progress = Callable[[Job, int], None]
"""Called with a job and the number of its events that are done."""

_LARGEST_ARRAY: Final = 1000  # jobs; Slurm takes no more than 1001 in one array unless configured
_CONNECT_S: Final = 20


class ExecutorError(RuntimeError):
    """Jobs cannot be handed over, for a reason that one line tells."""


class Executor(Protocol):
    """What does jobs."""

    def run(self, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Do all jobs and give the outcome of each, once, as they end; the results do not depend on where.

        Raises:
            ExecutorError: where none can be done.
        """


def make_executor(where: str, *, processes: int, folder: Path, progress: Progress | None = None) -> Executor:
    """What an executor's address stands for.

    Args:
        where: "local"; "dask://host:port"; or "slurm" or "slurm://partition", with parameters of submitit
            such as "slurm://gpu?timeout_min=600&mem_gb=8".
        processes: How many jobs to do at a time; a Dask cluster has its own say.
        folder: Of the results; Slurm's logs go to a hidden one inside.
        progress: For jobs that are done in this process.

    Raises:
        ValueError: an address of another form.
    """
    scheme, _, rest = where.partition("://")
    if where == "local":
        return LocalProcesses(processes, progress)
    if scheme == "dask" and rest:
        return DaskCluster(f"tcp://{rest}")
    if scheme == "slurm":
        partition, _, query = rest.partition("?")
        given = {name: values[-1] for name, values in urllib.parse.parse_qs(query).items()}
        numbers = {name: int(value) if value.isdigit() else value for name, value in given.items()}
        return Slurm(folder / ".slurm", partition=partition or None, at_a_time=processes, parameters=numbers)
    raise ValueError(f"executor is {where!r}, expected local, dask://host:port, slurm or slurm://partition")


@dataclass(frozen=True)
class LocalProcesses:
    """Some jobs at a time, each in a process of its own.

    Attributes:
        processes: How many; 1: all jobs in this process.
        progress: Called on the way; not across processes.
    """

    processes: int = 1
    progress: Progress | None = None

    def run(self, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """See :meth:`Executor.run`."""
        if self.processes <= 1 or len(jobs) <= 1:
            for job in jobs:
                yield run_job(job, self.progress and functools.partial(self.progress, job))
            return
        threads = max(1, (os.cpu_count() or 1) // self.processes)
        unfinished = yield from _run_pool([replace(job, threads=threads) for job in jobs], self.processes)
        for job in unfinished:  # a process died, and the pool with it: find out whose, one by one
            if (yield from _run_pool([job], 1)):
                yield Outcome(job, "failed", f"{job.source}: its process died, perhaps for want of memory")


def _run_pool(jobs: Sequence[Job], processes: int) -> Generator[Outcome, None, list[Job]]:
    """Outcomes as they end; returns the jobs that were open when a process died."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        min(processes, len(jobs)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_prepare_worker,
    )
    unfinished: list[Job] = []
    futures: dict[Future[Outcome], Job] = {}
    try:
        for job in jobs:
            try:
                futures[pool.submit(run_job, job)] = job
            except BrokenProcessPool:
                unfinished.append(job)
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except BrokenProcessPool:
                unfinished.append(futures[future])
            else:
                yield outcome
    except BaseException:  # interrupted: the workers clear their half-written results and go
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown()
    return unfinished


def _prepare_worker() -> None:
    """Leave a worker's end to its parent: no interrupt from the keyboard, but SIGTERM clears up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, exit_on_signal)


def exit_on_signal(number: int, frame: FrameType | None) -> NoReturn:
    """Signal handler: end by an exception, so that half-written results are removed on the way."""
    raise SystemExit(128 + number)


@dataclass(frozen=True)
class DaskCluster:
    """The workers of a Dask scheduler, which see the same files under the same names and have emseg.

    The scheduler gives the jobs of a worker that died to others.

    Attributes:
        address: The scheduler's, tcp://host:port.
    """

    address: str

    def run(self, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """See :meth:`Executor.run`."""
        distributed = _require("distributed")
        try:
            client = distributed.Client(self.address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ExecutorError(f"no Dask scheduler at {self.address}: {_line(error)}") from None
        with client:
            # Dask gives a job one thread of its worker.
            futures = {client.submit(run_job, _portable(job, threads=1), pure=False): job for job in jobs}
            try:
                for future in distributed.as_completed(futures, loop=client.loop):
                    yield _outcome(futures[future], future.result)
            finally:
                client.cancel(list(futures))


@dataclass(frozen=True)
class Slurm:
    """Arrays of Slurm jobs, through submitit; all nodes see the same files under the same names.

    Attributes:
        folder: Where submitit keeps what it hands over, and logs.
        partition: Slurm's partition; None: its default.
        at_a_time: How many jobs to run at a time; 1: as many as Slurm likes.
        parameters: Further parameters of submitit, such as timeout_min, cpus_per_task and mem_gb.
        cluster: What submitit runs them on: "slurm", or "local" processes for tests.
    """

    folder: Path
    partition: str | None = None
    at_a_time: int = 1
    parameters: dict[str, Any] = field(default_factory=dict)
    cluster: Literal["slurm", "local"] = "slurm"

    def run(self, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """See :meth:`Executor.run`."""
        submitit = _require("submitit")
        parameters: dict[str, Any] = {"name": "emseg", "timeout_min": 24 * 60, **self.parameters}
        if self.cluster == "slurm":
            if self.partition is not None:
                parameters["slurm_partition"] = self.partition
            if self.at_a_time > 1:
                parameters["slurm_array_parallelism"] = self.at_a_time
        try:
            executor = submitit.AutoExecutor(self.folder, cluster=self.cluster)
            executor.update_parameters(**parameters)
        except Exception as error:  # submitit has none of its own for what it refuses
            raise ExecutorError(f"no Slurm: {_line(error)}") from None
        handed: dict[Any, Job] = {}
        try:
            for start in range(0, len(jobs), _LARGEST_ARRAY):
                part = jobs[start : start + _LARGEST_ARRAY]
                try:
                    tasks = executor.map_array(run_job, [_portable(job, threads=0) for job in part])
                except Exception as error:
                    raise ExecutorError(f"Slurm takes no jobs: {_line(error)}") from None
                handed.update(zip(tasks, part, strict=True))
            for task in submitit.helpers.as_completed(list(handed), poll_frequency=0.5):
                yield _outcome(handed.pop(task), task.result)
        finally:
            for task in handed:
                task.cancel(check=False)


def _portable(job: Job, *, threads: int) -> Job:
    """The same job for a process that runs in another folder."""
    camera = None if job.camera is None else job.camera.resolve()
    return replace(
        job, source=job.source.resolve(), target=job.target.resolve(), camera=camera, threads=threads
    )


def _outcome(job: Job, result: Callable[[], Outcome]) -> Outcome:
    """A job's outcome from another machine, or that it died there."""
    try:
        outcome = result()
    except Exception as error:  # whatever the cluster's ways of losing a job are
        return Outcome(job, "failed", f"{job.source}: lost by the cluster: {_line(error)}")
    if outcome.status != "failed":
        clear_leftovers(job.target)  # of processes that died on the way to it, wherever they ran
    return outcome


def _require(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ExecutorError(f"{module} is not installed: pip install 'emseg[cluster]'") from None


def _line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[-1][:200]}" if lines else type(error).__name__
