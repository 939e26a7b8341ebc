"""Old names of arguments, which public functions take with a warning until the next minor version."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])


def accept_old_names(**names: str) -> Callable[[F], F]:
    """Return a decorator: a function accepts the old `names` of its arguments, too, each with its new one."""

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def accepting(*arguments: Any, **named: Any) -> Any:
            for old in names.keys() & named.keys():
                name, new = function.__qualname__, names[old]
                if new in named:
                    raise TypeError(f"{name}() got {new}= and its old name {old}=: leave out {old}=")
                sentence = f"{name}({old}=) is now {new}=; the next minor version takes only this"
                warnings.warn(sentence, DeprecationWarning, stacklevel=2)
                named[new] = named.pop(old)
            return function(*arguments, **named)

        return cast("F", accepting)

    return decorate
