"""Scan with the draws of all steps made beforehand, at once."""

from collections.abc import Callable, Sequence
from math import prod
from typing import Any, TypeVar

import jax
from jax.core import eval_jaxpr
from jax.extend.core import Jaxpr, JaxprEqn, Literal, Var

Carry = TypeVar("Carry")
Out = TypeVar("Out")
LARGEST = 256  # numbers of a value that is saved for every step: a draw has as many as a body has coordinates
MOST = 4096  # numbers that are saved for every step in all: 130 MB for 8,000 steps


def hoisted_scan(step: Callable[[Carry, Any], tuple[Carry, Out]], carry: Carry, inputs: Any) -> tuple[Carry, Out]:
    """Do what `jax.lax.scan(step, carry, inputs)` does, with what depends on the inputs alone computed before the loop.

    In a rollout these are the draws: from the keys of all steps at once they cost a fraction of what they cost one by one.
    Large values stay in the loop. A step with side effects, or whose values would fill the memory, is scanned as it is.
    """
    flat_carry, tree_carry = jax.tree.flatten(carry)
    flat_inputs, tree_inputs = jax.tree.flatten(inputs)

    def flat(*leaves: Any) -> Any:
        before, now = leaves[: len(flat_carry)], leaves[len(flat_carry) :]
        return step(jax.tree.unflatten(tree_carry, before), jax.tree.unflatten(tree_inputs, now))

    one = [jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype) for leaf in flat_inputs]
    program, shapes = jax.make_jaxpr(flat, return_shape=True)(*flat_carry, *one)
    jaxpr = program.jaxpr
    state_vars, input_vars = jaxpr.invars[: len(flat_carry)], jaxpr.invars[len(flat_carry) :]
    first, later = _parted(jaxpr.eqns, set(jaxpr.constvars), set(input_vars))
    saved = _needed(jaxpr, first, later, input_vars)
    if jaxpr.effects or jax.tree.structure(shapes[0]) != tree_carry or sum(map(_size, saved)) > MOST:
        return jax.lax.scan(step, carry, inputs)
    names = jaxpr.debug_info._replace(arg_names=None, result_paths=None)
    beforehand = Jaxpr(jaxpr.constvars, input_vars, saved, first, debug_info=names)
    within = Jaxpr(jaxpr.constvars, [*state_vars, *saved], jaxpr.outvars, later, debug_info=names)

    def one_step(now: list[Any], drawn: list[Any]) -> tuple[list[Any], list[Any]]:
        out = eval_jaxpr(within, program.consts, *now, *drawn)
        return out[: len(state_vars)], out[len(state_vars) :]

    drawn = jax.vmap(lambda *leaves: eval_jaxpr(beforehand, program.consts, *leaves))(*flat_inputs)
    end, outputs = jax.lax.scan(one_step, flat_carry, drawn, length=len(flat_inputs[0]))
    return jax.tree.unflatten(tree_carry, end), jax.tree.unflatten(jax.tree.structure(shapes[1]), outputs)


def _parted(equations: Sequence[JaxprEqn], constants: set[Var], inputs: set[Var]) -> tuple[list[JaxprEqn], list[JaxprEqn]]:
    """Those that can be computed beforehand, and those of the loop; what depends on nothing that changes is among both."""
    first, later, known = [], [], constants | inputs
    for equation in equations:
        named = {variable for variable in equation.invars if not isinstance(variable, Literal)}
        if named <= constants:
            constants.update(equation.outvars)
            later.append(equation)
        elif not named <= known or max(map(_size, equation.outvars), default=0) > LARGEST:
            later.append(equation)
            continue
        known.update(equation.outvars)
        first.append(equation)
    return first, later


def _needed(jaxpr: Jaxpr, first: list[JaxprEqn], later: list[JaxprEqn], input_vars: Sequence[Var]) -> list[Var]:
    """What the loop and the outputs read of the inputs and of what was computed beforehand."""
    computed = {*input_vars, *(variable for equation in first for variable in equation.outvars)}
    computed -= {variable for equation in later for variable in equation.outvars}
    read = [*(variable for equation in later for variable in equation.invars), *jaxpr.outvars]
    return [v for v in dict.fromkeys(v for v in read if not isinstance(v, Literal)) if v in computed]


def _size(variable: Any) -> int:
    return prod(variable.aval.shape)
