# Completion of lightstage-render: options and their words are those that its --help names.

_lightstage_render()
{
    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} words
    if [[ $current == -* ]]; then
        COMPREPLY=($(compgen -W "$(lightstage-render --help | grep -o -- '--[a-z-]\+' | sort -u)" -- "$current"))
    elif [[ $previous == --* ]] && words=$(lightstage-render --help |
        grep -m 1 -o -- "$previous [a-z0-9-]\+|[a-z0-9|-]\+"); then
        COMPREPLY=($(compgen -W "$(tr '|' ' ' <<<"${words#* }")" -- "$current"))
    elif ((COMP_CWORD == 1)); then
        COMPREPLY=($(compgen -d -- "$current") $(compgen -W "$(lightstagectl take list --json 2>/dev/null |
            grep -o '"id": "[^"]*"' | cut -d'"' -f4)" -- "$current"))
    else
        COMPREPLY=($(compgen -f -- "$current"))
    fi
}
complete -o filenames -F _lightstage_render lightstage-render
