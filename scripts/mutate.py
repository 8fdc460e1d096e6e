# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Do the tests see a fault? Change one operator of a function at a time, and run its tests.

Usage: python scripts/mutate.py [--count 300] [--seed 1] [--folders decision pose map]
[--seconds 60]; 170 mutants took half an hour of a core.
First the tests of the core run once, which records the functions that each test calls. Then each
mutant meets the tests that call it, the quickest first, as many as take so many seconds. It lives
only in the memory of a child process; files are not touched. It is caught if a test fails or does
not end. It prints those that live, as FILE:LINE change, and the share that is caught.
"""

import argparse
import ast
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
import contextlib
import gc
import importlib.util
import json
import os
from pathlib import Path
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
from types import CodeType, FrameType, FunctionType
from typing import Any

import pytest

TESTS = Path(__file__).resolve().parents[1] / 'test'
TESTED_BY = 'core', 'cli/test_sessions.py'
TOO_SLOW = 'test_golden', 'test_large_map', 'test_compiled', 'test_kernels', 'test_coherent'
OTHER: dict[type[ast.AST], Callable[[], Any]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.MatMult: ast.Add,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}  # fmt: skip
Functions = set[tuple[str, int]]  # file and first line of each
Operation = ast.BinOp | ast.AugAssign | ast.BoolOp
Changeable = Operation | ast.Compare | ast.UnaryOp | ast.If | ast.IfExp | ast.Expr
Site = tuple[Changeable, list[ast.FunctionDef]]  # what can be changed, and the functions around it


def sites(node: ast.AST, around: list[ast.FunctionDef] | None = None) -> Iterator[Site]:
    """Yield what can be changed: operators, conditions and calls whose result is not used."""
    around = around or []
    if around and (
        (isinstance(node, Operation) and type(node.op) in OTHER)
        or (isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER)
        or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not))
        or isinstance(node, ast.If | ast.IfExp)
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call))
    ):
        yield node, around
    inside: Iterable[ast.AST] = ast.iter_child_nodes(node)
    if isinstance(node, ast.FunctionDef):
        inside, around = node.body, [*around, node]
    for child in inside:
        if child is not getattr(node, 'annotation', None):
            yield from sites(child, around)


def changed(node: Changeable) -> str:
    """Change a site in place; return what was changed, as text."""
    before = ast.unparse(node).splitlines()[0]
    if isinstance(node, ast.Compare):
        node.ops[0] = OTHER[type(node.ops[0])]()
    elif isinstance(node, Operation):
        node.op = OTHER[type(node.op)]()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.Not()
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(ast.Not(), node.operand)
    elif isinstance(node, ast.Expr):
        call = node.value  # is still named: what a function encloses stays the same
        node.value = ast.BoolOp(ast.And(), [ast.Constant(None), call])
    else:
        node.test = ast.UnaryOp(ast.Not(), node.test)
    return f'{before}  ->  {ast.unparse(node).splitlines()[0]}'


def first_line(function: ast.FunctionDef) -> int:
    """Return the first line of a function, as its code object has it."""
    return min([function.lineno, *(one.lineno for one in function.decorator_list)])


@contextlib.contextmanager
def mutant(path: Path, tree: ast.Module, function: ast.FunctionDef) -> Iterator[None]:
    """Give a function, if it is imported, the code that it has in a changed tree."""

    def found_in(code: CodeType) -> Iterator[CodeType]:
        for inner in code.co_consts:
            if isinstance(inner, CodeType):
                if (inner.co_name, inner.co_firstlineno) == (function.name, first_line(function)):
                    yield inner
                yield from found_in(inner)

    (new,) = found_in(compile(ast.fix_missing_locations(tree), str(path), 'exec'))
    alike = str(path), function.name, first_line(function)
    live = [
        (one, one.__code__)
        for one in gc.get_objects()
        if isinstance(one, FunctionType)
        and (one.__code__.co_filename, one.__code__.co_name, one.__code__.co_firstlineno) == alike
    ]
    for one, _ in live:
        one.__code__ = new
    try:
        yield
    finally:
        for one, old in live:
            one.__code__ = old


class Recorder:
    """A plugin of pytest: which functions each test calls, and how long it takes."""

    def __init__(self, core: Path) -> None:
        self._core, self._called = f'{core}/', Functions()
        self._by_fixtures: dict[str, Functions] = {}  # by file
        self._by_tests: dict[str, Functions] = {}
        self._took_s = defaultdict[str, float](float)

    @property
    def record(self) -> dict[str, tuple[float, list[tuple[str, int]]]]:
        """By test: its seconds, and what it and the fixtures of its file call."""
        return {
            test: (round(self._took_s[test], 3), sorted(called | self._by_fixtures[file_of(test)]))
            for test, called in self._by_tests.items()
        }

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        called = self._by_fixtures.setdefault(file_of(item.nodeid), set())
        yield from self._recorded(item.nodeid, called)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        yield from self._recorded(item.nodeid, self._by_tests.setdefault(item.nodeid, set()))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            print(report.longrepr, report.nodeid, sep='\n', file=sys.stderr)

    def _recorded(self, test: str, called: Functions) -> Iterator[None]:
        self._called, begun_s = called, time.process_time()
        threading.settrace(self._trace)
        sys.settrace(self._trace)
        try:
            yield
        finally:
            sys.settrace(None)
            threading.settrace(None)
            self._took_s[test] += time.process_time() - begun_s

    def _trace(self, frame: FrameType, _event: str, _argument: object) -> None:
        code = frame.f_code
        if code.co_filename.startswith(self._core):
            self._called.add((code.co_filename.removeprefix(self._core), code.co_firstlineno))


def file_of(test: str) -> str:
    """Return the file of a test."""
    return test.split('::')[0]


class Mutants:
    """A plugin of pytest: runs tests once for each mutant, not once."""

    def __init__(self, chosen: argparse.Namespace) -> None:
        found = importlib.util.find_spec('convseq_ros')
        assert found and found.submodule_search_locations
        self._core, self._chosen = Path(found.submodule_search_locations[0], 'core'), chosen
        self._record: dict[str, Any] = {}

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Make a sample of mutants, and count those that tests catch."""
        if not self._passes(session, session.items, Recorder(self._core)):
            pytest.exit('a test fails without a fault: mend it first')
        caught, count, begun_s = 0, 0, time.monotonic()
        for path, number in self._sample():
            tree, name = ast.parse(path.read_text()), path.relative_to(self._core).as_posix()
            site, around = list(sites(tree))[number]
            what, tests = changed(site), self._tests(name, first_line(around[-1]), session.items)
            with mutant(path, tree, around[0]):
                lives = self._passes(session, tests)
            caught, count = caught + (not lives), count + 1
            if lives:
                print(f'lives: {name}:{site.lineno} {what} ({len(tests)} tests)', flush=True)
            if count % 10 == 0:
                minutes = (time.monotonic() - begun_s) / 60
                print(f'{caught} of {count} caught, {minutes:.0f} min', flush=True)
        print(f'{caught} of {count} caught')
        return True

    def _sample(self) -> list[tuple[Path, int]]:
        """Return files and the numbers of their sites."""
        folders = [self._core / name for name in self._chosen.folders]
        every = [
            (path, number)
            for folder in folders
            for path in sorted(folder.rglob('*.py'))
            for number, _ in enumerate(sites(ast.parse(path.read_text())))
        ]
        return random.Random(self._chosen.seed).sample(every, min(self._chosen.count, len(every)))

    def _tests(self, name: str, line: int, items: list[pytest.Item]) -> list[pytest.Item]:
        """Return the tests that call a function, the quickest first."""
        took_s, of_file = dict[pytest.Item, float](), defaultdict[str, float](float)
        for item in items:
            seconds, called = self._record.get(item.nodeid, (0.0, []))
            if [name, line] in called:
                took_s[item] = seconds
                of_file[file_of(item.nodeid)] += seconds
        tests, sum_s = list[pytest.Item](), 0.0
        for item in sorted(  # those of a file together: they share fixtures
            took_s, key=lambda one: (took_s[one] > 1, of_file[file_of(one.nodeid)], took_s[one])
        ):
            if sum_s + took_s[item] <= self._chosen.seconds or not tests:
                tests.append(item)
                sum_s += took_s[item]
        return tests

    def _passes(
        self, session: pytest.Session, tests: list[pytest.Item], recorder: Recorder | None = None
    ) -> bool:
        """Run tests in a child, and record them if asked; return whether all pass."""
        folder = tempfile.mkdtemp()
        child = os.fork()
        if child == 0:
            os.setsid()
            os.environ['PYTEST_DEBUG_TEMPROOT'] = folder
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 1)
            if recorder:
                session.config.pluginmanager.register(recorder)
            else:
                os.dup2(nothing, 2)
                for number in signal.SIGPROF, signal.SIGALRM:
                    signal.signal(number, lambda *_: os._exit(1))
                signal.setitimer(signal.ITIMER_PROF, 3 * self._chosen.seconds)
            with contextlib.suppress(BaseException):
                for item, following in zip(tests, [*tests[1:], None], strict=False):
                    # Of each test: on a busy machine, all together may take long.
                    signal.alarm(0 if recorder else 4 * self._chosen.seconds)
                    item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
                    if session.testsfailed:
                        break
                else:
                    if recorder:
                        Path(folder, 'record').write_text(json.dumps(recorder.record))
                    os._exit(0)
            os._exit(1)
        status = os.waitpid(child, 0)[1]
        with contextlib.suppress(ProcessLookupError):  # what it started
            os.killpg(child, signal.SIGKILL)
        if recorder and status == 0:
            self._record = json.loads(Path(folder, 'record').read_text())
        shutil.rmtree(folder, ignore_errors=True)
        return status == 0


def main() -> None:
    """Read the options, and have pytest collect the tests."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=300)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--folders', nargs='*', default=['decision', 'pose', 'map'])
    parser.add_argument('--seconds', type=int, default=60)
    del sys.path[0]  # this folder, whose modules have names of those of the tests
    options = '-s', '-p', 'no:terminal', '-p', 'no:cacheprovider', '-p', 'no:xdist'
    steady = '--hypothesis-profile=few', '--hypothesis-seed=1'
    tests = [str(TESTS / name) for name in TESTED_BY]
    tests += [f'--ignore={TESTS}/core/{name}.py' for name in TOO_SLOW]
    raise SystemExit(
        pytest.main([*options, *steady, *tests], plugins=[Mutants(parser.parse_args())])
    )


if __name__ == '__main__':
    main()
