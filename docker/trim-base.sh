#!/bin/sh
# Remove from the base what no part uses: installers of packages, documents, translations, perl,
# Python's own editor, tests and installer. The list of packages stays, for those who look for
# known faults in it.
set -eu
rm -rf /var/lib/apt /var/cache/* /var/log/* /etc/apt /usr/lib/apt /usr/bin/apt* /usr/bin/gpgv \
    /usr/share/doc /usr/share/man /usr/share/info /usr/share/locale /usr/share/lintian \
    /usr/share/perl* /usr/share/python-wheels /usr/bin/perl* /usr/lib/*/perl-base /usr/lib/*/gconv \
    /var/lib/dpkg/info /var/lib/systemd /usr/share/zoneinfo/right \
    /usr/lib/*/libapt-* /usr/lib/*/libgnutls* /usr/lib/*/libunistring* /usr/lib/*/libp11-kit*
for lib in /usr/local/lib/python3* /usr/lib/python3*; do
    [ -d "$lib" ] || continue
    rm -rf "$lib"/test "$lib"/idlelib "$lib"/turtledemo "$lib"/tkinter "$lib"/ensurepip \
        "$lib"/lib2to3 "$lib"/distutils "$lib"/pydoc_data "$lib"/site-packages "$lib"/dist-packages
done
find / -xdev -name '*.a' -delete
find /usr/local/bin -name 'pip*' -delete
