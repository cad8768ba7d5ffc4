#!/bin/sh
# Build .venv with the pinned packages: `sh scripts/setup.sh package` to run galoc, `... dev` to test it as well.
# A second run does nothing until pyproject.toml, constraints.txt or the place of the checkout changes.
set -eu
cd "$(dirname "$0")/.."

level=${1:-package}
case $level in
    package) target=. ;;
    dev) target='.[dev]' ;;
    *) echo "galoc set-up: got '$level'; expected 'package' or 'dev'." >&2; exit 2 ;;
esac
python=.venv/bin/python

say() { echo "galoc set-up: $*"; }
die() { echo "galoc set-up: $*" >&2; exit 1; }

# Scripts in .venv/bin and the editable install hold absolute paths, so a checkout that moved is set up anew.
place=$(pwd -P)
fingerprint="$place
$(cksum pyproject.toml constraints.txt)"

is_current() { [ -f ".venv/galoc-$1.stamp" ] && [ "$(cat ".venv/galoc-$1.stamp")" = "$fingerprint" ] && [ -x $python ]; }

# Run the candidate: a name on the PATH may be a version manager's shim for a Python that is not there.
version_fits() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' >/dev/null 2>&1; }
has_venv() { "$1" -c 'import venv, ensurepip' >/dev/null 2>&1; }

# Set `base` to a Python that can make environments.
find_python() {
    base='' without_venv=''
    if [ -n "${PYTHON:-}" ]; then
        version_fits "$PYTHON" || die "PYTHON=$PYTHON is not a Python from 3.11 to 3.14. Name another, or leave it out."
        set -- "$PYTHON"
    else
        set -- python3 python3.13 python3.12 python3.11 python3.14
    fi
    for candidate; do
        version_fits "$candidate" || continue
        if has_venv "$candidate"; then base=$candidate; return; fi
        [ -n "$without_venv" ] || without_venv=$candidate
    done
    [ -n "$without_venv" ] || die "no Python from 3.11 to 3.14 found. Install one (on Debian or Ubuntu:" \
        "apt-get install python3 python3-venv) or name it: make PYTHON=path/to/python3.11 <target>"
    package=$("$without_venv" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        say "installing the system package $package (Python's venv module is missing)"
        { apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq -y install --no-install-recommends "$package"
        } >/dev/null 2>&1 </dev/null || true
    fi
    has_venv "$without_venv" || die "$without_venv lacks its venv module. Run: apt-get install $package"
    base=$without_venv
}

pip() { "$python" -m pip --disable-pip-version-check --no-input "$@"; }

make_environment() {
    if [ -x $python ] && version_fits $python && $python -c 'import pip' >/dev/null 2>&1 &&
        [ "$(cat .venv/galoc-place 2>/dev/null)" = "$place" ]; then
        return
    fi
    find_python
    say "making .venv with $("$base" --version)"
    "$base" -m venv --clear .venv || die "could not make .venv with $base"
    echo "$place" > .venv/galoc-place
}

if is_current "$level" || { [ "$level" = package ] && is_current dev; }; then exit 0; fi
started=$(date +%s)
make_environment
rm -f .venv/galoc-package.stamp .venv/galoc-dev.stamp
say "installing the pinned packages into .venv (some 300 MB; one to a few minutes, once)"
# -qq leaves errors only.
pip install -qq -c constraints.txt -e "$target" || die "pip could not install galoc (reasons above); is the index reachable?"
echo "$fingerprint" > ".venv/galoc-$level.stamp.part"
mv ".venv/galoc-$level.stamp.part" ".venv/galoc-$level.stamp"
say "done in $(($(date +%s) - started)) s"
