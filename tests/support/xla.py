"""Compiling test programs quickly."""

import functools

import jax

# the fusion pass copies a shared value into each of its users: a step with derivatives would take minutes to compile
jit = functools.partial(jax.jit, compiler_options={"xla_disable_hlo_passes": "fusion"})
