"""The signature of a certificate (XMLDSig), made by signxml (``stepdiag[certificate]``)."""

from base64 import b64decode, b64encode
from pathlib import Path
from typing import Any

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import read_bytes
from stepdiag.base.messages import message
from stepdiag.certificate.custody import parsed


def _library() -> Any:
    try:
        import signxml
    except ImportError as error:
        raise UsageError(
            "--key-certificate", expected="stepdiag[certificate]", found=str(error)
        ) from error
    return signxml


def signed(certificate: bytes, key: Path, key_certificate: Path) -> bytes:
    """Return a certificate with a signature. Raises UsageError if the library or a file is missing,
    or the key is invalid."""
    signxml = _library()
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from lxml import etree

    try:
        own = serialization.load_pem_private_key(read_bytes(key), None)
        curve = isinstance(own, EllipticCurvePrivateKey)
        signer = signxml.XMLSigner(
            signature_algorithm="ecdsa-sha256" if curve else "rsa-sha256"
        )
        root = signer.sign(
            etree.fromstring(certificate), key=own, cert=read_bytes(key_certificate).decode()
        )
    except (ValueError, TypeError, signxml.exceptions.SignXMLException) as error:
        raise UsageError(
            str(key), expected=message("signature-key"), found=str(error)
        ) from error
    data: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return data + b"\n"


def require_signature(certificate: Path, key_certificate: Path) -> None:
    """Raise DataError unless a certificate is signed by the key of an X.509 certificate."""
    signxml = _library()
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.serialization import Encoding
    from lxml.etree import LxmlError

    data = read_bytes(certificate)
    parsed(data, certificate.name)
    try:
        found = (
            signxml.XMLVerifier()
            .verify(data, x509_cert=read_bytes(key_certificate).decode())
            .signature_xml
        )
        _require_plain(
            found,
            x509.load_pem_x509_certificate(read_bytes(key_certificate)).public_bytes(
                Encoding.DER
            ),
        )
    except (
        ValueError,
        LxmlError,
        InvalidSignature,
        signxml.exceptions.SignXMLException,
    ) as error:
        raise DataError(
            certificate.name, expected=message("signature-of-key"), found=str(error)
        ) from error


def _require_plain(signature: Any, certificate: bytes) -> None:
    """Raise ValueError for a change in the parts of a signature that the signature does not
    protect: another X.509 certificate, or another Base64 form of the same bytes."""
    texts = {
        name: "".join(signature.findtext(f".//{{*}}{name}", "").split())
        for name in ("SignatureValue", "X509Certificate")
    }
    for name, text in texts.items():
        found = b64decode(text, validate=True)
        if b64encode(found).decode() != text or (
            name == "X509Certificate" and found != certificate
        ):
            raise ValueError(name)
