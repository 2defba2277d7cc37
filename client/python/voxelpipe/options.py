"""Gives functions the options of call_options(), in their types and in help(), without a list of their own."""
from __future__ import annotations

import functools
import inspect
from typing import Any, Callable, Concatenate, ParamSpec, TypeVar

from .errors import UnknownOption
from .request import Call, Request, call_options

_Options = ParamSpec("_Options")
_Self = TypeVar("_Self")
_Mesh = TypeVar("_Mesh")
_Out = TypeVar("_Out")

_OF_CALLS = ("new_positions", "server", "timeout", "progress")  # how a request is made, not what
_OF_SEVERAL = ("together", "transforms", "names", "labels", "priorities", "motions")  # of which meshes


def _refuse(names: tuple[str, ...], options: dict[str, Any]) -> None:
    for name in names:
        if name in options:
            raise UnknownOption(f"{name}: this call has no such option", name)


def _refuse_positions(function: Any, given: tuple[Any, ...]) -> None:
    if given:
        raise TypeError(f"{function.__name__}() takes the mesh alone by position; options have names, as resolution=8")


def _describe(run: Any, function: Any, without: tuple[str, ...]) -> None:
    functools.update_wrapper(run, function)
    own = inspect.signature(function)
    kept = [parameter for name, parameter in own.parameters.items() if name != "call"]
    options = inspect.signature(call_options).parameters
    kept += [parameter for name, parameter in options.items() if name not in without]
    run.__signature__ = own.replace(parameters=kept)


def _request_of(make: Callable[_Options, Call]) -> Callable[_Options, Request]:
    def make_request(*_: _Options.args, **options: _Options.kwargs) -> Request:
        """The request that options of voxelize() describe. Errors: InvalidRequest, UnknownOption."""
        _refuse(_OF_CALLS + _OF_SEVERAL, options)
        return make(*_, **options).request

    return make_request


def _call_of(make: Callable[_Options, Call]) -> Callable[_Options, Call]:
    def make_call(*_: _Options.args, **options: _Options.kwargs) -> Call:
        """The same with what the options say of several meshes."""
        _refuse(_OF_CALLS, options)
        return make(*_, **options)

    return make_call


def _function_of(
    make: Callable[_Options, Call]
) -> Callable[[Callable[[_Mesh, Call], _Out]], Callable[Concatenate[_Mesh, _Options], _Out]]:
    def decorate(function: Callable[[_Mesh, Call], _Out]) -> Callable[Concatenate[_Mesh, _Options], _Out]:
        def run(mesh: _Mesh, /, *_: _Options.args, **options: _Options.kwargs) -> _Out:
            _refuse_positions(function, _)
            return function(mesh, make(*_, **options))

        _describe(run, function, ())
        return run

    return decorate


def _method_of(
    make: Callable[_Options, Call]
) -> Callable[[Callable[[_Self, _Mesh, Call], _Out]], Callable[Concatenate[_Self, _Mesh, _Options], _Out]]:
    def decorate(function: Callable[[_Self, _Mesh, Call], _Out]) -> Callable[Concatenate[_Self, _Mesh, _Options], _Out]:
        def run(self: _Self, mesh: _Mesh, /, *_: _Options.args, **options: _Options.kwargs) -> _Out:
            _refuse(("server",), options)
            _refuse_positions(function, _)
            return function(self, mesh, make(*_, **options))

        async def run_async(self: _Self, mesh: _Mesh, /, *_: _Options.args, **options: _Options.kwargs) -> Any:
            awaitable: Any = run(self, mesh, *_, **options)
            return await awaitable

        chosen: Any = run_async if inspect.iscoroutinefunction(function) else run
        _describe(chosen, function, ("server",))
        made: Callable[Concatenate[_Self, _Mesh, _Options], _Out] = chosen
        return made

    return decorate


# Options without those of calls, to a Request.
make_request = _request_of(call_options)
# Options without those of calls, to a Call.
make_call = _call_of(call_options)
# Decorates a function of (mesh, call).
with_options = _function_of(call_options)
# Decorates a method of a client, of (self, mesh, call): a client has its server.
client_method = _method_of(call_options)
