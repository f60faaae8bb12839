"""The verbs as a package of a colcon workspace; what they do is in the programs of keystore-audit."""

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
    description="The verbs `ros2 security audit` and `ros2 security record`",
    license="Apache-2.0",
    entry_points={"sros2.verb": [f"audit = {NAME}:AuditVerb", f"record = {NAME}:RecordVerb"]},
)
