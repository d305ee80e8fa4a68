# Shared by the tools; sourced, not run. Sets root, and an environment in which
# ROS finds its own Python whatever else stands first on PATH or was sourced.

root=$(cd "$(dirname "$0")/.." && pwd -P)
tool=tools/$(basename "$0")

PATH=/usr/bin:/bin:/usr/sbin:/sbin:$PATH
export PATH
unset CMAKE_PREFIX_PATH PYTHONHOME PYTHONPATH ROS_PACKAGE_PATH VIRTUAL_ENV

# Bash alone goes on where a program took Ctrl-C for an answer: Python that is
# interrupted while it starts ends with 1.
trap 'exit 130' INT

# say SENTENCE...: one line of progress.
say() {
    printf '%s: %s\n' "$tool" "$*"
}

# fail SENTENCE...: one line on the error output, then the end.
fail() {
    printf '%s: %s\n' "$tool" "$*" >&2
    exit 1
}

# source_workspace: what ROS and the package need, in this shell. Their setup files
# read variables that may not be set.
source_workspace() {
    set +u
    . "$root/.ws/devel/setup.bash"
    set -u
    export PATH=/usr/bin:$PATH
}

# help: print the comment at the head of the tool.
help() {
    sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"
}
