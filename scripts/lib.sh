# Shared by the scripts beside it: finds a Python and keeps .venv up to date with pyproject.toml.
# shellcheck shell=bash

ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
VENV="$ROOT/.venv"
PYTHON="$VENV/bin/python"
export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}" # as `pointit` has it: matrices are small
unset PYTHONDONTWRITEBYTECODE # set in many containers: every start would compile all that it imports
# uv trusts this system's certificates, as pip does: a company's proxy has its own among them, which uv does not know.
for bundle in /etc/ssl/certs/ca-certificates.crt /etc/pki/tls/certs/ca-bundle.crt /etc/ssl/ca-bundle.pem /etc/ssl/cert.pem; do
    if [ -s "$bundle" ]; then export UV_SYSTEM_CERTS="${UV_SYSTEM_CERTS:-true}"; fi
done

say() { printf '%s\n' "$*" >&2; }

die() {
    say "${0##*/}: $*"
    exit 1
}

if [ -f "$ROOT/pointit/services" ]; then
    remedy="the archive was unpacked without links; unpack it with a program that keeps them (\`unzip\`, \`tar\`), install a wheel, or clone the repository with git"
    if [ -e "$ROOT/.git" ]; then
        remedy="git wrote this checkout without links; on Windows, switch on its developer mode; then run \`git config core.symlinks true\`, then \`git checkout -- pointit\`"
    fi
    say "${0##*/}: pointit/services is a text file, not a symbolic link: $remedy"
    exit 2
fi

is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; }

# Prints the newest Python that will do, or nothing; $BASE_PYTHON goes before all others.
find_python() {
    local candidate
    for candidate in ${BASE_PYTHON:+"$BASE_PYTHON"} python3.14 python3.13 python3.12 python3.11 python3; do
        if command -v "$candidate" >/dev/null && is_new_enough "$candidate"; then
            command -v "$candidate"
            return
        fi
    done
}

# quietly SENTENCE COMMAND...: runs it without a word; says SENTENCE when it takes more than two seconds, with the
# seconds on a terminal, and leaves the output of one that failed in $LOG.
LOG=""
quietly() {
    local sentence=$1 tenths=0 job status=0
    shift
    [ -z "$LOG" ] || rm -f "$LOG" # of one that failed, in whose place this runs
    LOG="$(mktemp)"
    "$@" >"$LOG" 2>&1 </dev/null &
    job=$!
    # a background job of a script ignores Ctrl-C, so it is ended here
    trap 'kill "$job" 2>/dev/null || true; exit 130' INT TERM
    while kill -0 "$job" 2>/dev/null; do
        sleep 0.1
        tenths=$((tenths + 1))
        if [ "$tenths" -eq 20 ]; then say "$sentence ..."; fi
        if [ -t 2 ] && [ "$tenths" -gt 20 ] && [ $((tenths % 10)) -eq 0 ]; then
            printf '\e[A%s ... %d s\n' "$sentence" "$((tenths / 10))" >&2
        fi
    done
    wait "$job" || status=$?
    trap - INT TERM
    [ "$status" -ne 0 ] || rm "$LOG"
    return "$status"
}

make_venv() {
    local python
    python="$(find_python)"
    if command -v uv >/dev/null; then
        # uv fetches a Python by itself where there is none
        quietly "Making .venv" uv venv --quiet --python "${python:-3.12}" "$VENV" && return
    elif [ -z "$python" ]; then
        die "PointIt needs Python 3.11 or newer and found none; install python3.11 or newer and run this again"
    elif quietly "Making .venv" "$python" -m venv --without-pip "$VENV"; then
        return
    fi
    rm -rf "$VENV"
    tail -n 20 "$LOG" >&2
    die ".venv could not be made; what was said stands above"
}

has_pip() { "$1" -c 'import pip, sys; sys.exit(int(pip.__version__.split(".")[0]) < 23)' >/dev/null 2>&1; }

# Sets PIP: that of .venv, else the newest Python's, since making one takes seconds, else a new one in .venv.
find_pip() {
    local newest
    PIP=("$PYTHON" -m pip)
    if has_pip "$PYTHON"; then return; fi
    newest="$(find_python)"
    if has_pip "$newest"; then
        PIP=("$newest" -m pip --python "$PYTHON") # since pip 22.3
    elif ! "$PYTHON" -m ensurepip --default-pip >/dev/null 2>&1; then
        die "${newest:-$PYTHON} has no pip; on Debian and Ubuntu: apt install python3-venv"
    fi
}

# pip's configuration may say `user = true`, which is refused in a .venv (Manjaro ships it)
export PIP_USER=0

# Gives .venv the command `pip` if it has none: in an activated .venv, another Python's would run.
write_pip() {
    # shellcheck disable=SC2016 # the file expands it
    local command='env PATH="${0%/*}:$PATH" VIRTUAL_ENV="${0%/*}/.." uv pip'
    if has_pip "$PYTHON"; then return; fi
    if [ ! -x "$VENV/bin/uv" ] && ! command -v uv >/dev/null; then command="env PIP_USER=0 ${PIP[*]@Q}"; fi
    printf '#!/bin/sh\nexec %s "$@"\n' "$command" >"$VENV/bin/pip"
    chmod +x "$VENV/bin/pip"
}

# by_pip SENTENCE WHAT...
by_pip() { quietly "$1" "${PIP[@]}" install --quiet --disable-pip-version-check "${@:2}"; }

# Takes what pip takes. uv has options of the same names, and does it in a tenth of pip's time; where it is not, pip
# fetches it first, unless pip is told of an index, which uv would not ask. What such a uv cannot do, pip tries.
pip_install() {
    local sentence="Installing PointIt into .venv (only when pyproject.toml or the extras have changed)"
    if command -v uv >/dev/null; then
        quietly "$sentence" uv pip install --quiet --python "$PYTHON" "$@"
        return
    fi
    find_pip
    if [ ! -x "$VENV/bin/uv" ] && ! "${PIP[0]}" -m pip config list 2>/dev/null | grep index >/dev/null; then
        by_pip "Fetching uv, which installs faster than pip" uv || ! grep -q "connection broken" "$LOG" || return
    fi
    if [ -x "$VENV/bin/uv" ] && quietly "$sentence" "$VENV/bin/uv" pip install --quiet --python "$PYTHON" "$@"; then
        return
    fi
    by_pip "$sentence, by pip" "$@"
}

# Prints what is missing here to build those libraries of EXTRAS that have no wheel for this Python (vqf, pocketsphinx
# from 3.14 on), or nothing.
missing_for_build() {
    case ",$1,${LOCKED:+dev,}" in *,fusion,* | *,speech,* | *,test,* | *,dev,*) ;; *) return ;; esac
    "$PYTHON" - <<'END'
import importlib.util, os, pathlib, shutil, sys, sysconfig
if sys.version_info >= (3, 14) and not all(map(importlib.util.find_spec, ("vqf", "pocketsphinx"))):
    has = {"a C compiler": os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc"),
           "a C++ compiler": os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++"),
           "Python.h": (pathlib.Path(sysconfig.get_path("include")) / "Python.h").exists()}
    print(*(name for name, found in has.items() if not found), sep=", ")
END
}

# install EXTRAS, with commas between them: from what the index has now, or, with LOCKED set, exactly what
# requirements/ci.txt names, by hash. `lab` is a package in this checkout, not an extra: no index has it.
install() {
    local extras=",${1:-}," packages missing
    missing="$(missing_for_build "${1:-}" || true)"
    if [ -n "$missing" ]; then
        BUILD_PROBLEM="the extras fusion and speech are built for Python 3.14 and newer, and $missing is missing here; on Debian and Ubuntu: apt install build-essential python3-dev"
        say "${0##*/}: $BUILD_PROBLEM"
    fi
    if [ -z "${LOCKED:-}" ]; then
        case "$extras" in
            *,lab,* | *,test,* | *,dev,*) packages=(-e "$ROOT/lab") ;;
            *) packages=() ;;
        esac
        extras=${extras//,lab,/,} extras=${extras#,} extras=${extras%,}
        pip_install -e "$ROOT${extras:+[$extras]}" "${packages[@]}"
    else
        if ! command -v uv >/dev/null; then
            find_pip
            sed -n '/^uv==/,/[^\\]$/p' "$ROOT/requirements/ci.txt" >"$VENV/uv.txt" # a pip for another Python has no /dev/fd
            by_pip "Fetching uv" --require-hashes -r "$VENV/uv.txt" || return
        fi
        pip_install --require-hashes -r "$ROOT/requirements/ci.txt" &&
            pip_install --no-deps --no-build-isolation -e "$ROOT" -e "$ROOT/lab"
    fi
}

# ensure_venv [EXTRAS]: .venv is there, with PointIt and what it needs for them; `dev` has all of them.
ensure_venv() {
    local extra=${1:-} stamp wanted
    wanted="$ROOT $(cat "$ROOT/pyproject.toml" "$ROOT/lab/pyproject.toml" | cksum)${LOCKED:+ $(cksum <"$ROOT/requirements/ci.txt")}"
    for stamp in "$VENV/.installed${extra:+-$extra}" "$VENV/.installed-dev"; do
        if [ -x "$PYTHON" ] && [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ]; then return; fi
    done
    if [ -e "$VENV" ] && ! is_new_enough "$PYTHON"; then
        say "The Python of .venv is gone or older than 3.11: recreating .venv"
        rm -rf "$VENV"
    fi
    if [ ! -e "$VENV" ]; then make_venv; fi
    if ! install "$extra"; then
        tail -n 20 "$LOG" >&2
        die "${BUILD_PROBLEM:-PointIt could not be installed into .venv; what was said stands above}"
    fi
    write_pip
    printf '%s\n' "$wanted" >"$VENV/.installed${extra:+-$extra}"
}

# ensure_uv: sets UV to a uv: the system's, else one in .venv, which is made with nothing else in it.
ensure_uv() {
    UV="$(command -v uv || true)"
    if [ -n "$UV" ]; then return; fi
    UV="$VENV/bin/uv"
    if [ -x "$UV" ]; then return; fi
    if [ ! -e "$VENV" ]; then make_venv; fi
    find_pip
    if ! by_pip "Fetching uv, which builds the packages" uv; then
        tail -n 20 "$LOG" >&2
        die "uv could not be installed into .venv; what was said stands above"
    fi
}
