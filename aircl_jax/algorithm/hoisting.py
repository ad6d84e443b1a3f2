"""Scan with what depends on the scanned inputs alone computed beforehand, for all steps at once."""

from collections.abc import Callable, Sequence
from math import prod
from typing import Any, TypeVar

import jax
from jax.core import eval_jaxpr
from jax.extend.core import Jaxpr, JaxprEqn, Literal, Var

Carry = TypeVar("Carry")
Out = TypeVar("Out")
MOST = 256  # numbers of a value that is kept for every step; what has more is computed within the loop


def hoisted_scan(step: Callable[[Carry, Any], tuple[Carry, Out]], carry: Carry, inputs: Any) -> tuple[Carry, Out]:
    """Do what `jax.lax.scan(step, carry, inputs)` does, with all that no carry enters taken out of the loop.

    In a rollout these are the draws: from the keys of all steps at once they cost a fraction of what they cost one by one.
    A step with side effects is scanned as it is.
    """
    flat_carry, tree_carry = jax.tree.flatten(carry)
    flat_inputs, tree_inputs = jax.tree.flatten(inputs)

    def flat(*leaves: Any) -> Any:
        given = jax.tree.unflatten(tree_carry, leaves[: len(flat_carry)])
        return step(given, jax.tree.unflatten(tree_inputs, leaves[len(flat_carry) :]))

    one = [jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype) for leaf in flat_inputs]
    program, shapes = jax.make_jaxpr(flat, return_shape=True)(*flat_carry, *one)
    jaxpr = program.jaxpr
    if jaxpr.effects:
        return jax.lax.scan(step, carry, inputs)
    state, given = jaxpr.invars[: len(flat_carry)], jaxpr.invars[len(flat_carry) :]
    first, later = _parted(jaxpr.eqns, set(jaxpr.constvars), set(given))
    made = {*given, *(variable for equation in first for variable in equation.outvars)}
    unmade = {variable for equation in later for variable in equation.outvars}  # or made again
    wanted = [*(variable for equation in later for variable in equation.invars), *jaxpr.outvars]
    kept = [v for v in dict.fromkeys(v for v in wanted if not isinstance(v, Literal)) if v in made - unmade]
    about = jaxpr.debug_info._replace(arg_names=None, result_paths=None)
    beforehand = Jaxpr(jaxpr.constvars, given, kept, first, debug_info=about)
    within = Jaxpr(jaxpr.constvars, [*state, *kept], jaxpr.outvars, later, debug_info=about)

    def one_step(now: list[Any], drawn: list[Any]) -> tuple[list[Any], list[Any]]:
        out = eval_jaxpr(within, program.consts, *now, *drawn)
        return out[: len(state)], out[len(state) :]

    drawn = jax.vmap(lambda *leaves: eval_jaxpr(beforehand, program.consts, *leaves))(*flat_inputs)
    end, outputs = jax.lax.scan(one_step, flat_carry, drawn)
    return jax.tree.unflatten(tree_carry, end), jax.tree.unflatten(jax.tree.structure(shapes[1]), outputs)


def _parted(equations: Sequence[JaxprEqn], constants: set[Var], inputs: set[Var]) -> tuple[list[JaxprEqn], list[JaxprEqn]]:
    """Those that can be computed beforehand, and those of the loop; what depends on nothing that changes is among both."""
    first, later = [], []
    for equation in equations:
        named = {variable for variable in equation.invars if not isinstance(variable, Literal)}
        if named <= constants:
            constants = constants | set(equation.outvars)
            first.append(equation)
            later.append(equation)
        elif named <= constants | inputs and max(map(_size, equation.outvars), default=0) <= MOST:
            inputs = inputs | set(equation.outvars)
            first.append(equation)
        else:
            later.append(equation)
    return first, later


def _size(variable: Any) -> int:
    return prod(variable.aval.shape)
