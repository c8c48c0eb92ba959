#!/bin/sh
# after.sh COMMAND...: run it once what AFTER names is there: files, and hosts by their names.
trap 'exit 130' TERM INT
for each in ${AFTER:-}; do
    case $each in
    /*) until [ -e "$each" ]; do sleep 0.2; done ;;
    *) until getent hosts "$each" >/dev/null; do sleep 0.2; done ;;
    esac
done
exec "$@"
