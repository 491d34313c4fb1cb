"""Kept machine code runs only if it is what this user has written; on any doubt it is compiled anew."""

import ctypes
import os
import secrets

import jax
import pytest

pytest.importorskip("llvmlite")

from edhas_jax.compiler.llvm_jit import function
from edhas_jax.core import runtime

SOURCE = "define void @f(double* %x) {{\n  store double {0:.1f}, double* %x\n  ret void\n}}\n"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("EDHAS_CONFIG", str(tmp_path / "settings"))
    return tmp_path / "cache"


def result(cache, number=1.0, key="the same"):
    """What the function returns, and whether it was compiled."""
    compiled = []

    def assembly():
        compiled.append(True)
        return SOURCE.format(number)

    value = ctypes.c_double(0.0)
    function(assembly, "f", [ctypes.POINTER(ctypes.c_double)], cache, key)(value)
    return value.value, bool(compiled)


def kept(cache):
    (file,) = cache.glob("*.o")
    return file


def test_machine_code_is_kept(cache):
    assert result(cache) == (1.0, True)
    assert result(cache) == (1.0, False)
    assert kept(cache).stat().st_mode & 0o777 == 0o600
    assert result(None) == (1.0, True)


def flip(data, byte):
    return data[:byte] + bytes([data[byte] ^ 1]) + data[byte + 1 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:1],
        lambda data: data[:32],
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1],
        lambda data: data + b"\0",
        lambda data: flip(data, 0),
        lambda data: flip(data, 40),
        lambda data: flip(data, len(data) // 2),
        lambda data: flip(data, len(data) - 1),
        lambda data: secrets.token_bytes(len(data)),
    ],
    ids=["empty", "a byte", "a checksum", "half", "cut", "longer", "bit 0", "bit 320", "bit half", "last", "noise"],
)
def test_damaged_code_is_compiled_anew(cache, damage):
    result(cache)
    kept(cache).write_bytes(damage(kept(cache).read_bytes()))
    assert result(cache) == (1.0, True)
    assert result(cache) == (1.0, False)  # and kept again


def test_code_of_another_text_does_not_run(cache):
    result(cache)
    first = kept(cache)
    result(cache, 2.0, "another")
    (other,) = set(cache.glob("*.o")) - {first}
    first.write_bytes(other.read_bytes())
    assert result(cache) == (1.0, True)


def test_code_of_another_user_does_not_run(cache, tmp_path, monkeypatch):
    result(cache)
    name = kept(cache).name
    with monkeypatch.context() as other:
        other.setenv("EDHAS_CONFIG", str(tmp_path / "settings of another"))
        assert result(cache, 2.0) == (2.0, True)
        (theirs,) = [file for file in cache.glob("*.o") if file.name != name]
    theirs.replace(cache / name)
    assert result(cache) == (1.0, True)


@pytest.mark.parametrize("kind", ["writable by others", "other owner", "symbolic link", "pipe", "folder"])
def test_a_file_of_doubtful_origin_is_not_used(cache, monkeypatch, kind):
    result(cache)
    file = kept(cache)
    if kind == "writable by others":
        file.chmod(0o666)
    elif kind == "symbolic link":
        file.symlink_to(file.rename(cache / "elsewhere"))
    elif kind == "other owner":
        status = os.lstat

        def status_of_another(path):
            found = status(path)
            if os.fspath(path) != os.fspath(file):
                return found
            return os.stat_result([*found[:4], found.st_uid + 1, *found[5:10]])

        monkeypatch.setattr(os, "lstat", status_of_another)
    else:
        file.unlink()
        os.mkfifo(file) if kind == "pipe" else file.mkdir()
    assert result(cache) == (1.0, True)


@pytest.mark.parametrize("damage", ["readable by others", "cut", "no folder"])
def test_a_secret_that_is_none_is_replaced(cache, tmp_path, monkeypatch, damage):
    result(cache)
    secret = tmp_path / "settings/secret"
    assert secret.stat().st_mode & 0o777 == 0o600 and len(secret.read_bytes()) == 32
    old = secret.read_bytes()
    if damage == "readable by others":
        secret.chmod(0o644)
    elif damage == "cut":
        secret.write_bytes(b"short")
    else:
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("EDHAS_CONFIG", str(tmp_path / "file/settings"))  # cannot be made: nothing is kept
        assert result(cache) == (1.0, True) and result(cache) == (1.0, True)
        return
    assert result(cache) == (1.0, True) and result(cache) == (1.0, False)
    assert secret.read_bytes() != old and secret.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("doubt", ["", "folder open to others", "own folder open to others", "own folder is a link"])
def test_xla_programs_are_kept_in_a_private_folder_only(cache, tmp_path, monkeypatch, doubt):
    chosen = {}
    monkeypatch.setattr(runtime.jax.config, "update", chosen.__setitem__)
    monkeypatch.setenv("EDHAS_CACHE", str(cache))
    before = jax.config.jax_compilation_cache_dir
    if doubt:
        cache.mkdir(mode=0o700)
        if doubt == "folder open to others":
            cache.chmod(0o777)
        elif doubt == "own folder open to others":
            (cache / "xla").mkdir()
            (cache / "xla").chmod(0o770)
        else:
            (tmp_path / "theirs").mkdir(mode=0o700)
            (cache / "xla").symlink_to(tmp_path / "theirs")
    monkeypatch.setattr(type(runtime.jax.config), "jax_compilation_cache_dir", None, raising=False)
    runtime.keep_xla_programs()
    assert chosen.get("jax_compilation_cache_dir") == (None if doubt else str(cache / "xla"))
    monkeypatch.undo()
    assert jax.config.jax_compilation_cache_dir == before


def test_an_xla_program_that_jax_cannot_read_is_removed(tmp_path, monkeypatch):
    (tmp_path / "jit_add-0123-cache").write_bytes(b"damaged")
    (tmp_path / "jit_multiply-0123-cache").write_bytes(b"whole")
    monkeypatch.setattr(type(jax.config), "jax_compilation_cache_dir", str(tmp_path), raising=False)
    warning = "Error reading persistent compilation cache entry for 'jit_add': error: Error -5 while decompressing data"
    assert runtime.drop_damaged_program(warning) and not runtime.drop_damaged_program("something else")
    assert [file.name for file in tmp_path.iterdir()] == ["jit_multiply-0123-cache"]
