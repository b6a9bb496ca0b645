#!/usr/bin/env bash
# Builds a release with all features and makes its packages, into target/packages:
#
#   hil_scripts/packaging/package.sh [--out FOLDER]
#
#   starloop_VERSION_ARCH.deb               program, configurations, udev rules, systemd unit, completions, manual pages
#   starloop-VERSION-linux-ARCH.tar.gz      the same files below bin, lib and share, for any Linux with the glibc it names
#   starloop-VERSION-*.whl                  the Python package, with the program
#   Containerfile                           an image from the .deb
#   starloop-VERSION.cdx.json               the crates inside (CycloneDX)
#   SHA256SUMS                              of all of these: `sha256sum -c SHA256SUMS`
#
# Needs dpkg-deb, readelf, strip, cargo and Python 3.11. The same sources and program give the same bytes.
#
#   STARLOOP_BINARY      a program that is built already, with the Python module beside it: nothing is built then
#   SOURCE_DATE_EPOCH    time of the files, seconds since 1970 (default: that of the last commit)
set -euo pipefail
cd "$(dirname "$0")/../.."

out="${CARGO_TARGET_DIR:-target}/packages"
while [[ $# -gt 0 ]]; do
    case $1 in
    --out)
        [[ $# -ge 2 ]] || { echo "package.sh: --out wants a folder" >&2 && exit 2; }
        out=$2
        shift
        ;;
    *)
        echo "package.sh: got \"$1\", wanted --out FOLDER or nothing" >&2
        exit 2
        ;;
    esac
    shift
done
readonly out
[[ -n ${STARLOOP_BINARY:-} ]] || cargo build --locked --workspace --all-features --release --lib --bins
readonly binary="${STARLOOP_BINARY:-${CARGO_TARGET_DIR:-target}/release/starloop}"
folder=$(dirname "$binary")
readonly folder
readonly parts=hil_scripts/packaging
for file in "$binary" "$folder/lib_native.so"; do
    [[ -f $file ]] || {
        echo "package.sh: $file is missing: without STARLOOP_BINARY, package.sh builds it" >&2
        exit 1
    }
done
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
repository=$(sed -n 's/^repository = "\(.*\)"/\1/p' Cargo.toml)
machine=$(uname -m)
architecture=$(dpkg --print-architecture)
SOURCE_DATE_EPOCH="${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}"
export SOURCE_DATE_EPOCH
readonly version repository machine architecture

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
readonly tree="$work/tree" # as it is installed, below /usr
readonly package="$work/deb"

put() { install -D -m "$1" "$2" "$3"; }

# --- files -----------------------------------------------------------------------------------------------------------

put_programs() {
    put 755 "$binary" "$tree/bin/starloop"
    strip "$tree/bin/starloop"
}

put_shared_files() {
    local share=$tree/share file
    while IFS= read -r file; do
        put 644 "$file" "$share/starloop/$file"
    done < <(find configs -type f -name '*.toml')
    for file in hil_scripts/{starloop_client.py,starloop/*.py,requirements_flight_computer.txt,requirements_campaign.txt}; do
        put 644 "$file" "$share/starloop/python/${file#hil_scripts/}"
    done
    put 755 hil_scripts/packaging/host_setup.sh "$share/starloop/host_setup.sh"
    for file in INTERFACE.md FRAMES.md vectors.json dbc/starloop.dbc dbc/readdress.py c/starloop_protocol.c c/starloop_protocol.h c/example.c c/serial_flight.c; do
        put 644 "firmware_protocol/$file" "$share/starloop/firmware_protocol/$file"
    done
}

put_completions_and_pages() {
    local share=$tree/share page
    mkdir -p "$share/bash-completion/completions" "$share/zsh/vendor-completions" "$share/fish/vendor_completions.d"
    "$binary" completions bash >"$share/bash-completion/completions/starloop"
    "$binary" completions zsh >"$share/zsh/vendor-completions/_starloop"
    "$binary" completions fish >"$share/fish/vendor_completions.d/starloop.fish"
    "$binary" man "$share/man/man1" >/dev/null
    for page in "$share"/man/man1/*.1; do gzip -9n "$page"; done
}

put_documents() {
    local documents=$tree/share/doc/starloop file features
    features=$("$binary" doctor --json | python3 -c 'import json, sys; print(",".join(json.load(sys.stdin)["features"]))')
    mkdir -p "$documents"
    python3 hil_scripts/packaging/sbom.py "$work/sbom.cdx.json" --licences "$work/third_party_licences.txt" --features "$features"
    put 644 "$work/sbom.cdx.json" "$documents/sbom.cdx.json"
    gzip -9nc "$work/third_party_licences.txt" >"$documents/third_party_licences.txt.gz"
    gzip -9nc src/guide/changelog.md >"$documents/changelog.gz"
    for file in LICENSE-MIT LICENSE-APACHE README.md; do put 644 "$file" "$documents/$file"; done
    put 644 "$parts/copyright" "$documents/copyright"
    for file in src/guide/*.md; do put 644 "$file" "$documents/guide/$(basename "$file")"; done
}

# --- packages --------------------------------------------------------------------------------------------------------

# The newest version of glibc that a symbol of the program asks for.
glibc() {
    find "$tree/bin" -type f -exec readelf --dyn-syms --wide {} + |
        grep -o 'GLIBC_[0-9][0-9.]*' | sed 's/GLIBC_//' | sort -Vu | tail -1
}

# Same owners, order and times for everyone.
set_times() { find "$1" -exec touch --no-dereference --date="@$SOURCE_DATE_EPOCH" {} +; }

make_deb() {
    local file=$out/starloop_${version}-1_$architecture.deb
    mkdir -p "$package/usr" "$package/DEBIAN" "$package/etc/starloop"
    cp -a "$tree/." "$package/usr/"
    put 644 "$parts/60-starloop.rules" "$package/usr/lib/udev/rules.d/60-starloop.rules"
    put 644 "$parts/starloop@.service" "$package/usr/lib/systemd/system/starloop@.service"
    put 755 "$parts/postinst" "$package/DEBIAN/postinst"
    cat >"$package/DEBIAN/control" <<-CONTROL
	Package: starloop
	Version: $version-1
	Architecture: $architecture
	Maintainer: The starloop authors <starloop@localhost>
	Homepage: $repository
	Installed-Size: $(du -k --apparent-size -s "$package/usr" | cut -f1)
	Depends: libc6 (>= $(glibc)), libgcc-s1
	Recommends: libvulkan1
	Suggests: mesa-vulkan-drivers, libxkbcommon-x11-0, python3-can, python3-serial, can-utils, iproute2, linuxptp
	Section: science
	Priority: optional
	Description: star-sensor stimulator for hardware-in-the-loop tests
	 Attitude comes in over a bus, star-sensor frames go out on a deadline: to files, shared memory, network cameras
	 and displays, each with the truth about it. A simulated bus, flight computer and spacecraft are built in.
	CONTROL
    (cd "$package" && find usr -type f -print0 | sort -z | xargs -0 md5sum) >"$package/DEBIAN/md5sums"
    set_times "$package"
    dpkg-deb --root-owner-group -Zxz --build "$package" "$file" >/dev/null
    echo "$file"
}

make_tarball() {
    local name=starloop-$version-linux-$machine file
    file=$out/$name.tar.gz
    mv "$tree" "$work/$name"
    put 644 "$parts/60-starloop.rules" "$work/$name/lib/udev/rules.d/60-starloop.rules"
    cat >"$work/$name/INSTALL" <<-TEXT
	starloop $version for Linux on $machine with glibc $1 or newer.

	Run it where it is: bin/starloop run
	Or install it: tar -xzf $name.tar.gz -C /usr/local --strip-components=1

	share/doc/starloop has the guide, licences and the list of crates inside; share/starloop has configurations, clients in
	Python, the protocol and host_setup.sh.
	TEXT
    set_times "$work/$name"
    tar -C "$work" --sort=name --owner=0 --group=0 --numeric-owner --format=ustar -cf - "$name" | gzip -9n >"$file"
    echo "$file"
}

main() {
    local newest_glibc
    mkdir -p "$out"
    rm -f "$out"/starloop[_-]* "$out/SHA256SUMS" "$out/Containerfile"
    put_programs
    put_shared_files
    put_completions_and_pages
    put_documents
    newest_glibc=$(glibc)
    make_deb
    make_tarball "$newest_glibc"
    python3 hil_scripts/packaging/make_wheel.py --build "$folder" --out "$out"
    put 644 "$parts/Containerfile" "$out/Containerfile"
    put 644 "$work/sbom.cdx.json" "$out/starloop-$version.cdx.json"
    (cd "$out" && sha256sum starloop* Containerfile >SHA256SUMS)
    echo "needs glibc $newest_glibc; SHA256SUMS covers $(wc -l <"$out/SHA256SUMS") files in $out"
}

main
