"""``ph-post completion``: what a shell needs to complete commands, options, names and files."""

from __future__ import annotations

import sys

import click

from ph_post.cli import options

SHELLS = ("bash", "zsh", "fish")

LINES = {
    "bash": "echo 'eval \"$(ph-post completion bash)\"' >> ~/.bashrc",
    "zsh": "echo 'eval \"$(ph-post completion zsh)\"' >> ~/.zshrc",
    "fish": "ph-post completion fish > ~/.config/fish/completions/ph-post.fish",
}
"""What switches completion on for good, by shell."""


@click.command()
@click.argument("shell", type=click.Choice(SHELLS))
@options.common
def command(shell: str, as_json: bool) -> int:
    """Print the script that completes ph-post's commands, options, names and files in a shell.

    Once for every new shell: in bash, eval "$(ph-post completion bash)" as the last line of ~/.bashrc; in
    zsh the same with zsh in ~/.zshrc, behind compinit; in fish, the script as
    ~/.config/fish/completions/ph-post.fish. Completed are commands, options, shipped paths and machines,
    strategies, dialects, and files.

    \b
    Examples:
      ph-post completion bash > ph-post.bash
      ph-post completion zsh
      ph-post completion fish

    \b
    JSON:
      shell   its name
      script  what it has to run
      line    what switches completion on for good
    """
    from click.shell_completion import get_completion_class

    from ph_post.cli.main import COMPLETE_VARIABLE, cli

    complete = get_completion_class(shell)
    assert complete is not None
    script = complete(cli, {}, "ph-post", COMPLETE_VARIABLE).source()
    if as_json:
        from ph_post.report.tables import print_json

        print_json({"shell": shell, "script": script, "line": LINES[shell]})
    else:
        click.echo(script)
        if sys.stdout.isatty():  # not where every new shell reads it
            click.echo(f"for good: {LINES[shell]}", err=True)
    return 0
