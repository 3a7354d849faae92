#!/usr/bin/env bash
# Sees to it that there is a browser to test with: Chromium and Mesa from Debian's packages as root,
# else Playwright's own download; says how to get one where neither works. RONA_CHROMIUM names one.
set -uo pipefail

PYTHON="${PYTHON:-python3}"
PACKAGES="chromium libgl1-mesa-dri libegl1 fonts-dejavu-core"

playwright_has_one() {
    "$PYTHON" - <<'CODE' 2>/dev/null
import os, sys
from playwright.sync_api import sync_playwright
with sync_playwright() as p:
    sys.exit(not os.path.exists(p.chromium.executable_path))
CODE
}

if [ -n "${RONA_CHROMIUM:-}" ] && [ -x "$RONA_CHROMIUM" ]; then exit 0; fi

if command -v apt-get >/dev/null && command -v dpkg-query >/dev/null; then
    missing=""
    for package in $PACKAGES; do
        state=$(dpkg-query -W -f '${Status}' "$package" 2>/dev/null || true)
        [ "$state" = "install ok installed" ] || missing="$missing $package"
    done
    [ -z "$missing" ] && exit 0
    if [ "$(id -u)" = 0 ]; then
        echo "installing$missing"
        # shellcheck disable=SC2086 (a list of words)
        if apt-get update -qq </dev/null && DEBIAN_FRONTEND=noninteractive \
            apt-get install -y -qq --no-install-recommends $missing </dev/null >/dev/null; then
            exit 0
        fi
    fi
fi

for name in chromium chromium-browser google-chrome; do
    command -v "$name" >/dev/null && exit 0
done
playwright_has_one && exit 0
"$PYTHON" -m playwright install chromium </dev/null && exit 0

echo "There is no browser to test with, so the browser tests will be skipped. Install one by"
echo "    sudo apt-get install $PACKAGES"
echo "or name one you have:  RONA_CHROMIUM=/path/to/chrome make test"
[ "${CI:-}" = "true" ] && exit 1
exit 0
