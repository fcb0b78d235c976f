//! ONNX operators of the networks.
//!
//! Registering only these lets the linker drop about half of tract (recurrent, attention, quantised
//! and FFT operators among others). Attributes that the exported networks do not use (automatic
//! padding, groups of transposed convolutions) are rejected.

use tract_onnx::Onnx;
use tract_onnx::model::{OnnxOpRegister, ParsingContext};
use tract_onnx::pb::NodeProto;
use tract_onnx::tract_core::ops::cast::cast;
use tract_onnx::tract_core::ops::cnn::{Deconv, KernelFormat, deconv};
use tract_onnx::tract_hir::internal::*;
use tract_onnx::tract_hir::ops::{activations, array, cnn, konst, math, nn};

/// A node in tract: the operator, and the outer names used by a sub-graph.
type Built = TractResult<(Box<dyn InferenceOp>, Vec<String>)>;

/// Reader of ONNX graphs that consist of these operators.
pub(super) fn reader() -> Onnx {
    let mut register = OnnxOpRegister::default();
    register.insert("Constant", constant);
    register.insert("Cast", |_, node| built(expand(Cast { to: node.get_attr("to")? })));
    register.insert("Conv", convolution);
    register.insert("ConvTranspose", transposed_convolution);
    register.insert("Concat", |_, node| built(expand(array::Concat::new(node.get_attr("axis")?))));
    register.insert("GlobalAveragePool", |_, _| built(expand(nn::GlobalAvgPool)));
    register.insert("LeakyRelu", |_, node| {
        let slope = node.get_attr_opt("alpha")?.unwrap_or(0.01);
        built(expand(activations::LeakyRelu(slope)))
    });
    register.insert("Relu", |_, _| built(expand(activations::Clip::new(Some(0.0), None))));
    register.insert("Tanh", |_, _| built(math::tanh().into_hir()));
    register.insert("Sigmoid", |_, _| built(nn::sigmoid().into_hir()));
    register.insert("Add", |_, _| built(math::Add.into_hir()));
    register.insert("Sub", |_, _| built(math::Sub.into_hir()));
    register.insert("Mul", |_, _| built(math::Mul.into_hir()));
    register.insert("Div", |_, _| built(math::Div.into_hir()));
    // binary only; ONNX allows any number
    register.insert("Max", |_, node| pair(node, math::Max.into_hir()));
    register.insert("Min", |_, node| pair(node, math::Min.into_hir()));
    Onnx { op_register: register, ..Onnx::default() }
}

fn built(operator: Box<dyn InferenceOp>) -> Built {
    Ok((operator, vec![]))
}

fn pair(node: &NodeProto, operator: Box<dyn InferenceOp>) -> Built {
    ensure!(node.input.len() == 2, "{} of {} values", node.op_type, node.input.len());
    built(operator)
}

fn constant(context: &ParsingContext, node: &NodeProto) -> Built {
    let value = context.load_tensor(node.get_attr("value")?)?;
    built(Box::new(konst::Const::new(value.into_arc_tensor())?))
}

/// Padding before and after each axis.
fn padding(node: &NodeProto, axes: usize) -> TractResult<cnn::PaddingSpec> {
    let auto = node.get_attr_opt::<&str>("auto_pad")?.unwrap_or("NOTSET");
    ensure!(auto == "NOTSET", "automatic padding {auto}");
    let pads = node.get_attr_opt_tvec::<usize>("pads")?.unwrap_or_else(|| tvec!(0; 2 * axes));
    ensure!(pads.len() == 2 * axes, "{} paddings of {axes} axes", pads.len());
    Ok(cnn::PaddingSpec::Explicit(pads[..axes].into(), pads[axes..].into()))
}

fn convolution(_: &ParsingContext, node: &NodeProto) -> Built {
    let kernel = node.get_attr_tvec::<usize>("kernel_shape")?;
    let mut conv = cnn::Conv::default()
        .padding(padding(node, kernel.len())?)
        .kernel_shape(kernel)
        .group(node.get_attr_opt("group")?.unwrap_or(1));
    if let Some(dilations) = node.get_attr_opt_tvec("dilations")? {
        conv = conv.dilations(dilations);
    }
    if let Some(strides) = node.get_attr_opt_tvec("strides")? {
        conv = conv.strides(strides);
    }
    if node.input.len() == 3 {
        conv = conv.bias_input(2);
    }
    built(expand(conv))
}

fn transposed_convolution(_: &ParsingContext, node: &NodeProto) -> Built {
    ensure!(node.get_attr_opt::<usize>("group")?.unwrap_or(1) == 1, "grouped");
    ensure!(node.get_attr_opt_tvec::<usize>("output_shape")?.is_none(), "with a given result");
    let kernel = node.get_attr_tvec::<usize>("kernel_shape")?;
    let adjustments = node.get_attr_opt_tvec("output_padding")?;
    built(expand(TransposedConvolution {
        padding: padding(node, kernel.len())?,
        strides: node.get_attr_opt_tvec("strides")?,
        dilations: node.get_attr_opt_tvec("dilations")?,
        adjustments: adjustments.unwrap_or_else(|| tvec!(0; kernel.len())),
        bias: node.input.len() == 3,
    }))
}

/// Kernels in ONNX order: input channel, output channel, height, width.
#[derive(Debug, Clone)]
struct TransposedConvolution {
    padding: cnn::PaddingSpec,
    strides: Option<TVec<usize>>,
    dilations: Option<TVec<usize>>,
    adjustments: TVec<usize>,
    bias: bool,
}

impl TransposedConvolution {
    fn pool(&self, inputs: usize, outputs: usize, kernel: &[usize]) -> cnn::PoolSpec {
        cnn::PoolSpec::new(
            nn::DataFormat::NCHW,
            kernel.into(),
            self.padding.clone(),
            self.dilations.clone(),
            self.strides.clone(),
            inputs,
            outputs,
        )
    }
}

impl Expansion for TransposedConvolution {
    fn name(&self) -> StaticName {
        "ConvTranspose".into()
    }

    fn rules<'r, 'p: 'r, 's: 'r>(
        &'s self,
        s: &mut Solver<'r>,
        inputs: &'p [TensorProxy],
        outputs: &'p [TensorProxy],
    ) -> InferenceResult {
        check_input_arity(inputs, 2 + usize::from(self.bias))?;
        check_output_arity(outputs, 1)?;
        for input in inputs {
            s.equals(&input.datum_type, &outputs[0].datum_type)?;
        }
        s.equals(&inputs[0].rank, &outputs[0].rank)?;
        s.equals(&inputs[0].shape[1], &inputs[1].shape[0])?;
        s.given_2(&inputs[0].shape, &inputs[1].shape, move |s, input, kernel| {
            let kernel =
                kernel.iter().map(|d| Ok(d.to_usize()?)).collect::<TractResult<TVec<usize>>>()?;
            ensure!(kernel.len() >= 2, "a kernel of {} axes", kernel.len());
            let pool = self.pool(kernel[0], kernel[1], &kernel[2..]);
            s.equals(&outputs[0].shape, deconv::output_shape(&pool, &input, &self.adjustments)?)
        })
    }

    fn wire(
        &self,
        prefix: &str,
        model: &mut TypedModel,
        inputs: &[OutletId],
    ) -> TractResult<TVec<OutletId>> {
        let reorder = AxisOp::Move(0, 1);
        let kernel = model.wire_node(format!("{prefix}.kernel"), reorder, &[inputs[1]])?[0];
        let bias = if self.bias {
            inputs[2]
        } else {
            let zero = Tensor::zero_scalar_dt(model.outlet_fact(inputs[0])?.datum_type)?;
            model.add_const(format!("{prefix}.bias"), zero)?
        };
        let shape = &model.outlet_fact(kernel)?.shape;
        let shape = shape.as_concrete().context("the kernel's size is open")?;
        let pool = self.pool(shape[1], shape[0], &shape[2..]);
        let op = Deconv::new(pool, KernelFormat::OIHW, self.adjustments.clone(), 1);
        model.wire_node(prefix, op, &[inputs[0], kernel, bias])
    }
}

#[derive(Debug, Clone)]
struct Cast {
    to: DatumType,
}

impl Expansion for Cast {
    fn name(&self) -> StaticName {
        "Cast".into()
    }

    fn rules<'r, 'p: 'r, 's: 'r>(
        &'s self,
        s: &mut Solver<'r>,
        inputs: &'p [TensorProxy],
        outputs: &'p [TensorProxy],
    ) -> InferenceResult {
        check_input_arity(inputs, 1)?;
        check_output_arity(outputs, 1)?;
        s.equals(&outputs[0].datum_type, self.to.bex())?;
        s.equals(&outputs[0].shape, &inputs[0].shape)
    }

    fn wire(
        &self,
        prefix: &str,
        model: &mut TypedModel,
        inputs: &[OutletId],
    ) -> TractResult<TVec<OutletId>> {
        model.wire_node(prefix, cast(self.to), &[inputs[0]])
    }
}
