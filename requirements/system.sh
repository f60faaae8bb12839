#!/bin/sh
# Sees to what pip cannot bring: a Python that can make environments (venv), the oracles of the tests (test).
# Installs Debian packages as root only; else it says the command. usage: system.sh venv|test PYTHON
set -eu
purpose=$1 python=$2

version_check='import sys
sys.version_info >= (3, 10) or sys.exit("keystore-audit needs Python 3.10 or later; this one is " + sys.version.split()[0])'

has_header() { echo "#include <$2>" | "$1" -E -x "$3" - >/dev/null 2>&1; }

missing=
case $purpose in
venv)
    command -v "$python" >/dev/null || { echo "no $python here; name one: make PYTHON=python3.12" >&2; exit 1; }
    "$python" -c "$version_check" || { echo "name another: make PYTHON=python3.12" >&2; exit 1; }
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        missing="$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')"
    ;;
test)
    command -v openssl >/dev/null || missing="$missing openssl"
    command -v gcc >/dev/null || missing="$missing gcc"
    command -v g++ >/dev/null || missing="$missing g++"
    has_header gcc openssl/cms.h c || missing="$missing libc6-dev libssl-dev"
    command -v strace >/dev/null || missing="$missing strace"                      # what the kernel saw the program open
    # Fast DDS with its XML parser, Cyclone DDS with its own
    has_header g++ tinyxml2.h c++ || missing="$missing libtinyxml2-dev"
    has_header g++ fastrtps/config.h c++ || missing="$missing libfastrtps-dev"
    ldconfig -p 2>/dev/null | grep -q libACE-7 || missing="$missing libace-7.0.8"  # OpenDDS's matcher
    has_header gcc dds/ddsrt/xmlparser.h c || missing="$missing cyclonedds-dev"
    command -v chromium >/dev/null || missing="$missing chromium"                  # opens the HTML report
    command -v pdftotext >/dev/null || missing="$missing poppler-utils"            # reads what it prints
    ;;
*)
    echo "usage: system.sh venv|test PYTHON" >&2
    exit 2
    ;;
esac
[ -n "$missing" ] || exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    # shellcheck disable=SC2086 # a list of words
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
    exit 0
fi
echo "missing here; as root: apt-get install$(printf ' %s' $missing)" >&2
[ "$purpose" = test ] # the tests skip what they lack (in CI they fail), but without an environment nothing runs
