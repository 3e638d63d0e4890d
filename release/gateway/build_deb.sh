#!/bin/sh
# A Debian package of the static binary, beside it: build_deb.sh dist/modlens-tap-aarch64 arm64
set -eu
binary=$1 debian=$2
dist=$(dirname "$binary")
cd "$(dirname "$0")/../.."
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"/\1/p' Cargo.toml)
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
install -D -m 755 "$binary" "$root/usr/bin/modlens-tap"
install -D -m 644 release/gateway/modlens-tap.service "$root/lib/systemd/system/modlens-tap.service"
install -D -m 644 release/gateway/modlens-tap.default "$root/etc/default/modlens-tap"
mkdir -p "$root/usr/share/doc/modlens-tap" "$root/DEBIAN"
cat LICENSE THIRD_PARTY_LICENSES.txt > "$root/usr/share/doc/modlens-tap/copyright"
echo /etc/default/modlens-tap > "$root/DEBIAN/conffiles"
cat > "$root/DEBIAN/control" <<END
Package: modlens-tap
Version: $version
Architecture: $debian
Maintainer: modlens developers <modlens@localhost>
Section: comm
Priority: optional
Recommends: ca-certificates
Description: passive tap for Modbus lines
 Listens to a serial line, records it, and hands its transactions on as
 JSON lines and by MQTT. It never sends.
END
chmod 755 "$root"
dpkg-deb --root-owner-group --build "$root" "$dist/modlens-tap_${version}_$debian.deb"
