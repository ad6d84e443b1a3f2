"""The commands. Importing them settles devices and the compilation cache before anything imports jax."""

from aircl_jax import runtime

runtime.prepare()
