# Completion of lightstagectl: commands, options and their words are those that its --help names.

_lightstagectl()
{
    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} command word
    local commands options words
    commands=$(lightstagectl --help | sed -n 's/^  \([a-z]\+\( [a-z]\+\)\?\)  .*/\1/p')
    for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
        [[ $word == -* ]] && break
        if grep -q "^$command${command:+ }$word\( \|\$\)" <<<"$commands"; then
            command+=${command:+ }$word
        fi
    done
    if ! grep -qx "$command" <<<"$commands"; then # the rest of a command's name
        COMPREPLY=($(compgen -W "$(sed -n "s/^$command${command:+ }\([a-z]\+\).*/\1/p" <<<"$commands")" -- "$current"))
    elif [[ $current == -* ]]; then
        options=$(lightstagectl $command --help | grep -o -- '--[a-z-]\+' | sort -u)
        COMPREPLY=($(compgen -W "$options" -- "$current"))
    elif [[ $previous == --* ]] && words=$(lightstagectl $command --help |
        grep -m 1 -o -- "$previous [a-z0-9-]\+|[a-z0-9|-]\+"); then
        COMPREPLY=($(compgen -W "$(tr '|' ' ' <<<"${words#* }")" -- "$current"))
    elif [[ $command == take\ @(show|verify|slate|resume) || $command == @(fetch|relight|export) ]] &&
        [[ $previous == "${command##* }" ]]; then
        COMPREPLY=($(compgen -W "$(lightstagectl take list --json 2>/dev/null |
            grep -o '"id": "[^"]*"' | cut -d'"' -f4)" -- "$current"))
    else
        COMPREPLY=($(compgen -f -- "$current"))
    fi
}
complete -o filenames -F _lightstagectl lightstagectl
