# Completion of lightstage-render: options are those that its --help names.

_lightstage_render()
{
    local current=${COMP_WORDS[COMP_CWORD]}
    if [[ $current == -* ]]; then
        COMPREPLY=($(compgen -W "$(lightstage-render --help | grep -o -- '--[a-z-]\+' | sort -u)" -- "$current"))
    elif ((COMP_CWORD == 1)); then
        COMPREPLY=($(compgen -d -- "$current") $(compgen -W "$(lightstagectl take list --json 2>/dev/null |
            grep -o '"id": "[^"]*"' | cut -d'"' -f4)" -- "$current"))
    else
        COMPREPLY=($(compgen -f -- "$current"))
    fi
}
complete -o filenames -F _lightstage_render lightstage-render
