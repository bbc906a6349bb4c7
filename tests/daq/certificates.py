"""An authority, a certificate for one address, and passwords, in a folder; by openssl."""

from __future__ import annotations

import subprocess
from pathlib import Path

ELLIPTIC = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


def make_certificates(folder: Path, address: str) -> None:
    """ca.pem, rig.pem and rig.key for ``address``, and passwords of lab and guest."""

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)

    openssl(
        "req", "-x509", *ELLIPTIC, "-days", "2", "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=Test authority"
    )
    (folder / "ext").write_text(f"subjectAltName=IP:{address}\nbasicConstraints=CA:FALSE\n")
    openssl("req", *ELLIPTIC, "-keyout", "rig.key", "-out", "rig.csr", "-subj", "/CN=rig")
    signing = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-extfile", "ext")
    openssl("x509", "-req", "-in", "rig.csr", *signing, "-out", "rig.pem")
    write_passwords(folder / "passwords", "lab:secret\nguest:guest\n")


def write_passwords(path: Path, text: str) -> None:
    """A password file that nobody else can read."""
    path.write_text(text)
    path.chmod(0o600)
