"""Compilation of JAX functions of scalars: linearisation, sparse elimination, scalar IR, machine code, C, loops."""
