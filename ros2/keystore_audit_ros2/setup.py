"""The verb as a package of a colcon workspace; what it does is in keystore-audit."""

from setuptools import setup

NAME = "keystore_audit_ros2"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="keystore-audit",
    maintainer_email="keystore-audit@example.org",
    description="The verb `ros2 security audit`",
    license="Apache-2.0",
    entry_points={"sros2.verb": [f"audit = {NAME}:AuditVerb"]},
)
