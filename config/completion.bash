# Completes the names of poses and options in bash; sourced by the workspace's setup.bash.
#
#   rosrun g1_description pose <TAB>
#   rosrun g1_description record --<TAB>
#   roslaunch g1_description display.launch initial_pose:=<TAB>
#
# Everything else is left to what completed rosrun and roslaunch before.

_g1_description_config=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

# Print the names of all poses of all robots: keys at the beginning of a line.
_g1_description_poses() {
    local own=${ROS_HOME:-$HOME/.ros}/g1_description
    sed -n 's/^\([A-Za-z][A-Za-z0-9_-]*\):.*/\1/p' "$_g1_description_config"/robots/*/poses.yaml \
        "$own"/robots/*/poses.yaml "$own/poses.yaml" 2>/dev/null
}

# Options by command, those without a value, those whose value is a file, the commands of
# motion, and the links of the doctor; tools/tables writes them.
declare -gA _g1_description_options
# table of commands
_g1_description_options[check]="--against --all --collisions --csv --dask --engine --fixed-base --format --fps --help --html --input-joint-order --jobs --json --model --motors --no-visual-hulls --only --order --physics --plot --quiet --scene --selection --shift --thresholds --topic --watch --write-selection"
_g1_description_options[collision_pairs]="--help --out --samples --seed"
_g1_description_options[doctor]="--help --json --namespace --until"
_g1_description_options[import_model]="--convex-collisions --decimate --force --help --keep-missing --out --tolerance"
_g1_description_options[motion]="--all --begin --blend --dry-run --duration --end --fastest --force --format --fps --from --help --html --input-joint-order --jobs --joint-order --joints --json --keep-hands --max-base --max-change --model --names --only --order --out --physics --rate --seconds --selection --speed --stay --thresholds --to --topic --until"
_g1_description_options[moveit_config]="--force --help --model --scene"
_g1_description_options[play]="--anchor --base-frame --format --fps --from --help --lead-in --loop --namespace --on-floor --order --scene --speed --start-here --topic --until"
_g1_description_options[pose]="--about --anchor --file --force --help --list --model --namespace --save --seconds"
_g1_description_options[record]="--force --gazebo --help --last --model --namespace --rate --seconds"
_g1_description_options[snapshot]="--forces --fps --gif --help --joints --model --motion --motion-format --motion-fps --motion-order --motion-topic --namespace --scene --seconds --size --time --view"
_g1_description_options[web]="--collisions --compare --format --fps --help --host --model --motion --order --port --read-only --report --scene --selection --thresholds --topic"
_g1_description_options[why]="--help --model --namespace --seconds"
_g1_description_flags=" --all --convex-collisions --dry-run --fastest --fixed-base --force --forces --gif --html --json --keep-hands --keep-missing --list --loop --no-visual-hulls --on-floor --physics --quiet --read-only --start-here --stay --watch "
_g1_description_files=" --against --collisions --compare --csv --file --html --json --model --motion --motors --out --plot --report --scene --selection --thresholds --write-selection "
_g1_description_motion="info convert cut join mirror retime resample pad floor mend rename"
_g1_description_links="python packages master address nodes description meshes simulator clock time link_states bridge model urdf joint_states state_publisher tf diagnostics picture"
# end of commands

_g1_description_rosrun() {
    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}
    local command=
    [[ $COMP_CWORD -ge 3 && ${COMP_WORDS[1]} == g1_description ]] && command=${COMP_WORDS[2]}
    if [[ -z $command || -z ${_g1_description_options[$command]-} ]]; then
        _g1_description_otherwise rosrun "$@"
    elif [[ $command == motion && $COMP_CWORD == 3 ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$_g1_description_motion --help" -- "$word")
    elif [[ $command == doctor ]]; then
        _g1_description_doctor "$word" "$before"
    elif [[ $command != pose ]]; then
        _g1_description_file "$word" "$before"
    elif [[ $before == --file ]]; then
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -f -- "$word")
    elif [[ $word == -* ]]; then
        mapfile -t COMPREPLY < <(compgen -W "${_g1_description_options[pose]}" -- "$word")
    elif [[ $before == --seconds || $before == --namespace || $before == --about ]]; then
        COMPREPLY=()
    else
        mapfile -t COMPREPLY < <(compgen -W "$(_g1_description_poses)" -- "$word")
    fi
}

# Complete an option of the doctor, or the link that it stops at.
_g1_description_doctor() {
    local words=
    if [[ $2 == --until ]]; then
        words=$_g1_description_links
    elif [[ $1 == -* ]]; then
        words=${_g1_description_options[doctor]}
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$1")
}

# Complete an option, or a file, of a command whose other arguments are files.
_g1_description_file() {
    if [[ $1 == -* ]]; then
        mapfile -t COMPREPLY < <(compgen -W "${_g1_description_options[${COMP_WORDS[2]}]}" -- "$1")
    elif [[ $2 == --* && $_g1_description_flags$_g1_description_files != *" $2 "* ]]; then
        COMPREPLY=()
    else
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -f -- "$1")
    fi
}

# Readline takes := for a word of its own, or for the end of one that is empty.
_g1_description_roslaunch() {
    local before=${COMP_WORDS[*]:1:COMP_CWORD} word=${COMP_WORDS[COMP_CWORD]}
    [[ $word == := || $word == = ]] && word=
    if [[ ${COMP_WORDS[1]-} == g1_description && $before =~ initial_pose\ ?:=\ ?[^\ ]*$ ]]; then
        compopt +o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -W "$(_g1_description_poses)" -- "${word##*:=}")
    else
        _g1_description_otherwise roslaunch "$@"
    fi
}

# Let the function that completed a command before do it.
_g1_description_otherwise() {
    local function=_g1_description_${1}_before
    shift
    [[ -n ${!function-} ]] && "${!function}" "$@"
}

# Take a command over, with the options that it had.
_g1_description_take() {
    local now=_g1_description_$1 spec
    spec=$(complete -p "$1" 2>/dev/null) || spec="complete -o bashdefault -o default $1"
    if [[ $spec =~ \ -F\ \"?([A-Za-z0-9_:.-]+)\"?\  ]]; then
        [[ ${BASH_REMATCH[1]} == "$now" ]] && return
        printf -v "${now}_before" %s "${BASH_REMATCH[1]}"
        spec=${spec/"${BASH_REMATCH[0]}"/ }
    else
        printf -v "${now}_before" %s ""
    fi
    eval "${spec% *} -F $now $1"
}

_g1_description_take rosrun
_g1_description_take roslaunch
unset -f _g1_description_take
