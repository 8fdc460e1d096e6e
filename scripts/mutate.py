# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Do the tests see a fault? Change one operator of the code at a time, and run the tests of it.

Usage: python scripts/mutate.py [--count 300] [--seed 1] [--folders decision pose map], an hour on
an idle core. A mutant lives only in the memory of a child process; files are not touched. It is
caught if a test fails or does not end. It prints those that live, as FILE:LINE change, and the
share that is caught.
"""

import argparse
import ast
from collections.abc import Iterator
import contextlib
import importlib.util
import os
from pathlib import Path
import random
import signal
import sys
import time
from types import ModuleType

TESTS = Path(__file__).resolve().parents[1] / 'test'
# The tests of a file or folder, the quickest first; the longest name that fits counts.
CONCERN = {
    'decision': 'decision/test_observation decision/test_belief_decider test_keypoints',
    'decision/belief.py': 'decision/test_belief decision/test_belief_decider',
    'decision/likelihood.py': 'decision/test_likelihood decision/test_observation test_keypoints',
    'decision/localizer.py': 'decision/test_localizer test_recognizer',
    'decision/odometry_jump.py': 'decision/test_odometry_jump decision/test_odometry_prior',
    'decision/odometry_prior.py': 'decision/test_odometry_prior decision/test_belief_decider',
    'decision/paper': 'decision/test_decider test_sequence',
    'decision/paper/query_buffer.py': 'test_sequence decision/test_observation test_recognizer',
    'pose': 'test_relative_geometry test_pose test_estimate test_image_pose',
    'map': 'test_map_file test_reference_map test_hostile_map test_damaged_log test_autosave '
    'test_links test_stored_links',
    'map/online.py': 'test_recent_places test_pruning test_rounds test_pipeline',
    'map/pruning.py': 'test_pruning',
    'map/edit.py': 'test_links test_stored_links test_pruning test_map_builder '
    '../cli/test_sessions',
}
LONGEST_S = 300  # of processor time
OTHER = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.MatMult: ast.Add,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}  # fmt: skip


def sites(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield what can be changed: operators, conditions and calls whose result is not used."""
    for node in ast.walk(tree):
        for name in ('returns', 'annotation'):  # types are no code
            if hasattr(node, name):
                setattr(node, name, None if name == 'returns' else ast.Constant(None))
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp) and type(node.op) in OTHER:
            yield node
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
            yield node
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            yield node
        elif isinstance(node, ast.If | ast.IfExp):
            yield node
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            yield node


def changed(node: ast.AST) -> str:
    """Change a site in place; return what was changed, as text."""
    before = ast.unparse(node).splitlines()[0]
    if isinstance(node, ast.Compare):
        node.ops[0] = OTHER[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp):
        node.op = OTHER[type(node.op)]()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.Not()
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(ast.Not(), node.operand)
    elif isinstance(node, ast.Expr):
        node.value = ast.Constant(None)
    else:
        node.test = ast.UnaryOp(ast.Not(), node.test)
    return f'{before}  ->  {ast.unparse(node).splitlines()[0]}'


class Mutant:
    """An import hook that gives one module changed."""

    def __init__(self, name: str, tree: ast.Module, path: Path) -> None:
        self._name, self._code = name, compile(ast.fix_missing_locations(tree), str(path), 'exec')
        self._path = path

    def find_spec(self, name: str, _path: object = None, _target: object = None) -> object:
        if name != self._name:
            return None
        return importlib.util.spec_from_file_location(name, self._path, loader=self)

    def create_module(self, _spec: object) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        exec(self._code, module.__dict__)


def lives(mutant: Mutant | None, tests: list[str]) -> bool:
    """Run tests in a child; return whether all pass."""
    child = os.fork()
    if child == 0:
        os.setsid()
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        signal.signal(signal.SIGPROF, lambda *_: os._exit(1))
        with open(os.devnull, 'w') as null:
            os.dup2(null.fileno(), 1)
            os.dup2(null.fileno(), 2)
        if mutant:
            sys.meta_path.insert(0, mutant)
        del sys.path[0]  # this folder, whose modules have names of those of the tests
        import pytest

        code = 1
        with contextlib.suppress(BaseException):
            options = '-x', '-q', '-p', 'no:cacheprovider', '-p', 'no:xdist', '--tb=no'
            code = int(pytest.main([*options, '--hypothesis-profile=few', *tests]))
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def concern(name: str) -> list[str]:
    """Return the tests of a file of the core."""
    (best,) = sorted((key for key in CONCERN if name.startswith(key)), key=len)[-1:]
    return [str(TESTS / 'core' / f'{test}.py') for test in CONCERN[best].split()]


def main() -> None:
    """Make a sample of mutants, and count those that tests catch."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=300)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--folders', nargs='*', default=['decision', 'pose', 'map'])
    chosen = parser.parse_args()
    import cv2  # noqa: F401  # once for all children
    import numpy as np  # noqa: F401

    (package,) = importlib.util.find_spec('convseq_ros').submodule_search_locations
    core = Path(package, 'core')
    files = [path for name in chosen.folders for path in sorted((core / name).rglob('*.py'))]
    every = [
        (path, number)
        for path in files
        for number, _ in enumerate(sites(ast.parse(path.read_text())))
    ]
    sample = random.Random(chosen.seed).sample(every, min(chosen.count, len(every)))
    for tests in {tuple(concern(path.relative_to(core).as_posix())) for path, _ in sample}:
        if not lives(None, [*tests]):
            raise SystemExit(f'without a fault, one of these fails: {" ".join(tests)}')
    caught, begun_s = 0, time.monotonic()
    for count, (path, number) in enumerate(sample, 1):
        tree, name = ast.parse(path.read_text()), path.relative_to(core).as_posix()
        site = list(sites(tree))[number]
        what, line = changed(site), site.lineno
        module = 'convseq_ros.core.' + name.removesuffix('.py').replace('/', '.')
        if lives(Mutant(module.removesuffix('.__init__'), tree, path), concern(name)):
            print(f'lives: {name}:{line} {what}', flush=True)
        else:
            caught += 1
        if count % 10 == 0 or count == len(sample):
            minutes = (time.monotonic() - begun_s) / 60
            print(f'{caught} of {count} caught, {minutes:.0f} min', flush=True)


if __name__ == '__main__':
    main()
