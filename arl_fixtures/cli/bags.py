"""`arl recover` and `arl cloud`: what can be done with a bag alone."""

from __future__ import annotations

from pathlib import Path

import click

from arl_fixtures.recording.cloud import write_cloud
from arl_fixtures.recording.recover import recover as recover_bag

BAG = click.argument("bag", type=click.Path(path_type=Path))
OUT = click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="folder of the new bag")


@click.command()
@BAG
@OUT
def recover(bag: Path, out: Path | None) -> None:
    """Rewrite a cut bag from every complete message in it; the old one stays as it is."""
    click.echo(str(recover_bag(bag, out)))


@click.command()
@BAG
@OUT
def cloud(bag: Path, out: Path | None) -> None:
    """Write the point clouds of a step's first returns as sensor_msgs/PointCloud2 into a new bag."""
    click.echo(str(write_cloud(bag, out)))
