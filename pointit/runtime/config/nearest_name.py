"""Advice for a name that does not exist or is an old one."""

import difflib
import functools
import warnings
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return `did you mean a or b?` with the up to three of `names` that are similar, or `""`."""
    similar = difflib.get_close_matches(name, list(names), n=3, cutoff=0.6)
    return f"did you mean {' or '.join(similar)}?" if similar else ""


def nearest(name: str, names: Iterable[str]) -> str:
    """Return `did you mean a or b?`, or `there are a, b, c` (or `none`) if no name is similar."""
    known = list(names)
    listed = ", ".join(known) or "none"
    return did_you_mean(name, known) or f"there are {listed}"


def accept_old_names(**names: str) -> Callable[[F], F]:
    """Return a decorator: a function accepts the old `names` of its arguments, too, each with its new one."""

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def accepting(*arguments: Any, **named: Any) -> Any:
            for old in names.keys() & named.keys():
                name = function.__qualname__
                new = names[old]
                if new in named:
                    problem = f"{name}() got {new}= and its old name {old}="
                    raise TypeError(f"{problem}: leave out {old}=")
                sentence = f"{name}({old}=) is now {new}=; the next minor version takes only this"
                warnings.warn(sentence, DeprecationWarning, stacklevel=2)
                named[new] = named.pop(old)
            return function(*arguments, **named)

        return cast("F", accepting)

    return decorate
