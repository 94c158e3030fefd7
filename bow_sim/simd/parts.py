"""Functions that are only called by compiled functions: parts, compiled once, with the whole that they are linked into.

Numba compiles a function completely, to machine code that Python can call, before its caller; the caller contains a
copy and compiles it again, and so on up to the function that Python calls: what is called five levels below it is
optimised six times. A part is translated to LLVM's language only. Optimisation and machine code follow once, for the
whole.
"""

from __future__ import annotations

from typing import Any

import numba
from numba import _dynfunc
from numba.core import compiler, typed_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import register_pass

OPTIONS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Numba's options for a function that nobody but compiled code calls: nothing that unpacks Python's arguments."""


class _Library(JITCodeLibrary):
    """The code of a part, with that of the parts that it calls; neither optimised across them nor loaded."""

    def finalize(self) -> None:
        """Link what this part calls."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._final_module.verify()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(typed_passes.NativeLowering):
    """Translates a part to LLVM's language."""

    _name = "bow_part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = _Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        name = state.func_id.func_qualname.split(".")[-1]
        # what Numba knows the function by; without machine code it must not be called
        key = _dynfunc.make_function(lowered.fndesc.lookup_module(), name, "part", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(key, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=key)
        return True


class Pipeline(compiler.CompilerBase):
    """Numba's passes, but for the last."""

    def define_pipelines(self) -> list[Any]:
        """Return the only sequence of passes."""
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state, "bow_part")
        passes.passes = [
            (_Lowering, text) if found is typed_passes.NativeLowering else (found, text)
            for found, text in passes.passes
        ]
        passes._finalized = False
        passes.finalize()
        return [passes]


def part_of(function: Any, options: dict[str, Any]) -> Any:
    """Return a function as a part. Called from Python, as tests do, it is compiled as any function of Numba's."""
    dispatcher = numba.njit(pipeline_class=Pipeline, **OPTIONS, **options)(function)
    whole = numba.njit(**options)(function)

    def add_overload(result: Any) -> None:
        dispatcher.overloads[tuple(result.signature.args)] = result  # but do not offer it to Python

    dispatcher.add_overload = add_overload
    dispatcher._compile_for_args = lambda *args, **kwargs: whole
    return dispatcher
